"""A page with a moving dimer, sliders for its parameters, and the map of a cube whose points show their runs."""
