"""A cube in the format is that which is made in memory; it is read, taken for what it is, extended and refused if damaged."""

from pathlib import Path

import dimersweep

GRID = {"Gamma": [0.6, 0.9, 1.0]}
HOW = {"periods": 60, "progress": False, "workers": 1}

made = dimersweep.sweep(GRID, out="cube.npz", **HOW)
read = dimersweep.open_cube("cube.npz")
assert read.equals(dimersweep.sweep(GRID, **HOW))
assert read.identical(made)
assert dimersweep.sweep(GRID, out="cube.npz", **HOW).attrs["history"] == made.attrs["history"]  # it is there already
longer = dimersweep.sweep({"Gamma": [*GRID["Gamma"], 1.1]}, out="longer.npz", extend="cube.npz", **HOW)
assert longer["mode"][:3].equals(made["mode"])
Path("cube.npz").write_bytes(Path("cube.npz").read_bytes()[:-100])
try:
    dimersweep.open_cube("cube.npz")
except dimersweep.StoreError as error:
    assert str(error).startswith("cube.npz: ")
else:
    raise AssertionError("a damaged cube was read")
