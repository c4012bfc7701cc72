"""The observer's number stands in the cube, is resumed and read back, and belongs to what the cube is of."""

from pathlib import Path

import dimersweep

GRID = {"Gamma": [0.6, 0.9, 1.0]}
HOW = {"periods": 60, "progress": False, "workers": 1}
FILE = """
[sweep]
periods = 60
busy = true
output = "file.nc"
[grid]
Gamma = [0.6, 0.9, 1.0]
"""

cube = dimersweep.sweep(GRID, busy=True, out="cube.nc", **HOW)
assert (cube["events_per_period"] == cube["n_events"] / cube["n_periods"]).all()
assert cube["events_per_period"].attrs["units"] == "1"
assert dimersweep.open_cube("cube.nc").identical(cube)
try:
    dimersweep.sweep(GRID, out="cube.nc", **HOW)
except dimersweep.StoreError:
    pass
else:
    raise AssertionError("a cube without the number was taken for one with it")
Path("file.toml").write_text(FILE)
declared = dimersweep.read_declaration("file.toml")
assert dimersweep.make(declared, "file.nc", progress=False).equals(cube)
