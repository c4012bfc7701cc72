"""The slow motion: families of orbits over the spin, its flow along them, and where it comes to rest."""
