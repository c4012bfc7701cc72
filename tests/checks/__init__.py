"""What tests and benchmarks share: scenes and differences of states, energies, and the kernel's functions made callable."""
