"""The number is in a run, in a cube with its unit and meaning, in its file, and in the table of columns."""

import dimersweep

run = dimersweep.simulate(periods=2)
assert 0.2 < run.fastest < 3.0
cube = dimersweep.sweep({"Gamma": [0.8, 0.9]}, periods=2, out="cube.nc", progress=False, workers=1)
assert cube["fastest"].attrs["units"] == "m s-1"
assert (cube["fastest"] > 0.2).all()
assert float(cube["fastest"][1]) == run.fastest
assert dimersweep.open_cube("cube.nc").identical(cube)
