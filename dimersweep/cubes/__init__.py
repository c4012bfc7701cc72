"""The data: grids of points, their results, labelled cubes and what is read off them."""
