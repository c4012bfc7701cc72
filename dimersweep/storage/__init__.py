"""Files on disk: cubes in their formats, and stores of finished tiles."""
