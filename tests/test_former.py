"""Files of version 1.0 are read, gone on with and extended, as all later versions must."""

import json
import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pytest
import xarray as xr

from dimersweep import load_run, names, open_cube, sweep
from dimersweep.storage.cubefiles import open_result
from tests.checks.former import LEFT_OUT, STOPPED_SWEEP
from tests.checks.kinds_of_files import KINDS
from tests.checks.public import FORMER
from tests.fakes import fake_run_many
from tests.seams import another_version, rows_made

CUBES = [kind for kind in KINDS if "cube" in kind and kind not in LEFT_OUT] + ["refined map"]
TABLES = ("branch", "borders", "border curve", "family", "sustained spins", "attractors")


def path_of(kind):
    return FORMER / f"{kind.replace(' ', '_')}.nc"


def as_of_the_kernel_of(patch, configuration):
    """Let the kernel of a file be this one: what is tried here is how files are read."""
    another_version(patch, json.loads(configuration)["kernel_version"])


@pytest.mark.parametrize("kind", CUBES)
@pytest.mark.filterwarnings("ignore:the cube was made by another version of the kernel")
def test_a_cube_is_opened_and_the_run_behind_a_point_made_again(kind):
    cube = open_cube(path_of(kind))
    place = np.argwhere(names(cube["mode"]).values == "drift")[0]
    point = cube.isel(dict(zip(cube["mode"].dims, place, strict=True)))
    assert point.dimersweep.run().mode == point.dimersweep.modes().item()


@pytest.mark.filterwarnings("ignore:.*was made by another version of the kernel")
def test_a_run_is_loaded_and_goes_on():
    run = load_run(path_of("run"))
    assert run.mode == "drift" and run.n_periods == 60
    assert run.states([0.5])["x"].size == 1
    assert run.go_on(periods=2).n_periods == 62


@pytest.mark.parametrize("kind", TABLES)
def test_a_table_is_opened_and_drawn(kind):
    table = open_result(path_of(kind))
    assert table.dimersweep.to_dataframe().size
    if kind != "sustained spins":
        assert table.dimersweep.plot().axes


def test_a_stopped_sweep_goes_on(monkeypatch, tmp_path):
    store = tmp_path / "stopped.nc.tiles"
    shutil.copy(FORMER / store.name, store)
    with closing(sqlite3.connect(store)) as stored:
        ((configuration,),) = stored.execute("SELECT value FROM about WHERE name = 'configuration'")
        ((there,),) = stored.execute("SELECT sum(stop - start) FROM tiles")
    as_of_the_kernel_of(monkeypatch, configuration)
    made = rows_made(monkeypatch, fake_run_many)
    cube = sweep(**STOPPED_SWEEP, out=tmp_path / "stopped.nc", progress=False)
    assert 0 < there < cube["mode"].size
    assert sum(map(len, made)) == cube["mode"].size - there


def test_a_cube_is_extended(monkeypatch):
    former = open_cube(path_of("cube"))
    as_of_the_kernel_of(monkeypatch, former.attrs["configuration"])
    made = rows_made(monkeypatch, fake_run_many)
    grid = {"f": [15, 20, 25, 30], "beta0": former["beta0"].values}
    cube = sweep(grid, periods=200, extend=path_of("cube"), progress=False)
    assert sum(map(len, made)) == former.sizes["beta0"]
    xr.testing.assert_equal(cube["radius"].sel(f=former["f"]), former["radius"])
