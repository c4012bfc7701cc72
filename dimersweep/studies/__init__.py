"""What is asked of many runs: sweeps, searches, refined maps, and their declarations."""
