"""Every table that a public verb returns goes through a file of xarray's own, and is drawn by xarray over its parameter."""

import numpy as np
import pytest
import xarray as xr

from dimersweep import attractors, loops, orbits, simulate, sweep

STARTS = {"beta0": (0.2, 0.6)}
TABLES = {
    "follow": lambda: orbits.follow(orbits.find(spin=100.0), "Gamma", to=0.91),
    "follow in the spin": lambda: orbits.follow(orbits.find(spin=100.0), "spin", to=104.0, sequences=False),
    "family": lambda: orbits.family(spin=(0.0, 20.0), points=3),
    "border": lambda: orbits.border("fold", "Gamma", over={"e": [0.6]}, spin=100.0),
    "border_curve": lambda: orbits.border_curve("fold", "Gamma", "e", span=(0.6, 0.602), spin=100.0),
    "attractors": lambda: attractors(STARTS, starts=3, periods=120, progress=False),
    "attractors over": lambda: attractors(STARTS, starts=2, over={"e": [0.6, 0.61]}, periods=120, progress=False),
    "sweep": lambda: sweep({"Gamma": [0.5, 0.9]}, periods=60, progress=False),
    "loops": lambda: loops(sweep({"Gamma": [0.8, 0.9]}, periods=60, carry="both", progress=False)),
    "events": lambda: simulate(periods=60).events,
    "states": lambda: simulate(periods=60).states([0.0, 1.0]),
    "energy": lambda: simulate(periods=60).energy(),
    "energy by event": lambda: simulate(periods=60).energy(by="event"),
    "section": lambda: simulate(periods=60).section(at="double_impact"),
    "error": lambda: simulate(periods=60).error(),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_written_by_xarray_and_read_back(name, tmp_path):
    table = TABLES[name]()
    path = tmp_path / "table.nc"
    table.to_netcdf(path)
    with xr.open_dataset(path) as stored:
        stored.load()
    assert set(stored.variables) == set(table.variables)
    for column in table.variables:
        np.testing.assert_array_equal(stored[column].values, table[column].values, err_msg=column)


def test_xarray_draws_a_branch_over_its_parameter_and_a_curve_over_the_other_one():
    branch, curve = TABLES["follow"](), TABLES["border_curve"]()
    for table, x, y in ((branch, "Gamma", "radius"), (curve, "e", "Gamma"), (curve, "Gamma", "radius")):
        (line,) = table[y].plot(x=x)
        np.testing.assert_array_equal(line.get_xdata(), table[x].values)
        np.testing.assert_array_equal(line.get_ydata(), table[y].values)
