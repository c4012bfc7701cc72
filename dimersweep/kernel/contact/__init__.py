"""Sustained contact: forces, modes, events, and the phase from start to end."""
