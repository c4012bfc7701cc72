"""Impacts at one end and at both."""
