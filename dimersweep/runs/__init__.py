"""One run: its outcome, its record, its errors, its stability."""

from dimersweep.faces import reachable

__getattr__ = reachable(__name__, "growth", "outcomes")
