"""Continuation: steps along a branch of orbits, the events on it, and its ends."""
