"""A map to click: a cube's map, sliders for its further axes, and the run behind the point that is clicked."""
