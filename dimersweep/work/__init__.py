"""Run points on threads or clusters: tiles, scheduling, progress, signals."""
