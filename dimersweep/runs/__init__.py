"""Make one run: its start, its outcome, its record, its errors, its stability, its file."""

from dimersweep.faces import reachable

__getattr__ = reachable(__name__, "growth", "outcomes")
