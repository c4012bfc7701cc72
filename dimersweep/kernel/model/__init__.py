"""The model: the dimer's body, the plate, friction, and the layout of states."""
