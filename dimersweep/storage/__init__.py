"""All that touches the disk: cubes as files, and the store of finished tiles."""
