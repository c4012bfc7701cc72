"""The analysis: orbits and their borders, attractors, fits; the engine, which runs and sweeps, needs nothing of it."""
