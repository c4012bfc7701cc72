"""Borders: their curves over other parameters, and their pictures."""
