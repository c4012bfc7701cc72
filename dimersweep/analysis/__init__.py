"""The analysis: orbits and their borders, attractors, fits. The engine, which runs and sweeps, does not import it."""
