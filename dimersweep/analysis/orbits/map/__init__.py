"""The return map: points of a section, Newton's method for fixed points, the slow manifold, and orbits."""
