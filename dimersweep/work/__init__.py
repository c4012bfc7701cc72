"""Who runs the points and where: tiles, threads, clusters, progress, signals."""
