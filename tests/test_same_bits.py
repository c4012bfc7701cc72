"""A sweep gives one cube, bit for bit: in series, in threads, on processes, in two tilings, and after random kills."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import dimersweep
from dimersweep import make
from dimersweep.cubes.cube import build, signed
from dimersweep.cubes.results import Tile
from dimersweep.storage.provenance import attributes
from dimersweep.storage.tilestore import tiles_of
from dimersweep.studies.declared import read_declaration
from dimersweep.studies.search import search
from dimersweep.studies.status import status, status_lines
from dimersweep.studies.sweep import study_of
from tests.fakes import points_on_disk, run_tile
from tests.seams import set_chunks, set_pace
from tests.sweeper import GRID, MAKERS, SEARCH, SEARCHED, SETTINGS, SMALL_MAP

ROOT = Path(__file__).parents[1]
pytestmark = [pytest.mark.jit, pytest.mark.slow]


def bits(cube):
    """Every byte, type and attribute of the variables of a cube, and the configuration."""
    told = {}
    for name, variable in cube.variables.items():
        values = variable.values
        values = values.astype(str) if values.dtype.kind == "O" else values  # texts, as a file gives them
        told[name] = variable.dims, values.dtype.str, values.tobytes(), {k: str(v) for k, v in variable.attrs.items()}
    return told | {"configuration": cube.attrs.get("configuration")}


def assert_same(cube, reference):
    told, expected = bits(cube), bits(reference)
    assert told.keys() == expected.keys()
    for name in expected:
        assert told[name] == expected[name], name


def swept(**settings):
    return dimersweep.sweep(GRID, **SETTINGS, progress=False, **settings)


@pytest.fixture(scope="module")
def serial():
    """All points in one call of the tile function, without any scheduling or file."""
    spec = study_of(GRID, **SETTINGS)
    results = run_tile(spec, Tile(0, spec.grid.size))
    known = spec.configuration()
    cube = signed(build(spec.grid, results["out"], results["codes"], attributes(known, "serial", 0)), known)
    counts = np.bincount(cube["mode"].values.ravel(), minlength=9)
    assert (counts > 0).sum() >= 4, "the grid should hold several modes"
    return cube


@pytest.mark.parametrize("length", [1, 37])
def test_threads_and_tilings(serial, monkeypatch, tmp_path, length):
    set_pace(monkeypatch, length)
    assert_same(swept(workers=2), serial)
    assert_same(swept(workers=3, out=tmp_path / "cube.nc"), serial)
    assert_same(dimersweep.open_cube(tmp_path / "cube.nc"), serial)


def test_zarr(serial, tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    set_chunks(monkeypatch, 70)
    assert_same(swept(out=tmp_path / "cube.zarr"), serial)
    assert os.listdir(tmp_path) == ["cube.zarr"]


@pytest.fixture(scope="module")
def others(serial, tmp_path_factory):
    """Of each kind, the cube that nothing has disturbed: but for the sweep, in one thread and without any file."""
    made = {"sweep": serial}
    for kind in ("search", "map", "carry", "observed"):
        made[kind] = MAKERS[kind](None, workers=1)
    return made


@pytest.mark.parametrize("length", [1, pytest.param(5, marks=pytest.mark.release)])
def test_threads_and_tilings_of_a_search(others, monkeypatch, tmp_path, length):
    set_pace(monkeypatch, length)
    assert_same(MAKERS["search"](tmp_path / "cube.nc", workers=3), others["search"])
    assert_same(dimersweep.open_cube(tmp_path / "cube.nc"), others["search"])


@pytest.fixture(scope="module", params=[2, pytest.param(4, marks=pytest.mark.release)])
def client(request):
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=request.param, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        yield client


# an observer on the process of a worker is in test_own_observers
HERE_ALONE = pytest.param("observed", marks=pytest.mark.release)


@pytest.mark.parametrize("kind", [HERE_ALONE if kind == "observed" else kind for kind in MAKERS])
def test_processes(others, client, tmp_path, kind):
    assert_same(MAKERS[kind](tmp_path / "cube.nc", client=client), others[kind])
    assert_same(dimersweep.open_cube(tmp_path / "cube.nc"), others[kind])


def test_the_address_of_a_scheduler_serves_too(serial, client):
    assert_same(swept(client=client.scheduler.address), serial)


def start(kind, out, workers):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(ROOT / "tests" / "sweeper.py"), kind, str(out), str(workers), "0.05"]
    return subprocess.Popen(command, env=environment, cwd=out.parent)


KILLS = [("sweep", 2)]
MORE_KILLS = [
    ("map", 1),
    ("sweep", 3),
    ("search", 1),
    ("search", 2),
    ("map", 2),
    ("carry", 1),
    ("carry", 2),
    ("observed", 1),
    ("observed", 2),
]


@pytest.mark.parametrize(
    ("kind", "kills"),
    [*KILLS, *(pytest.param(*each, marks=pytest.mark.release) for each in MORE_KILLS)],
)
def test_kills_at_random_moments(others, tmp_path, kind, kills):
    out, chance = tmp_path / "cube.nc", random.Random(kills)
    done = []
    for kill in range(kills):
        with start(kind, out, workers=1 + kill % 3) as process:
            while not tiles_of(out).exists():
                time.sleep(0.01)
            if kill:  # at least one after the first tiles, the others anywhere
                time.sleep(chance.uniform(0.0, 1.5))
            else:
                while not points_on_disk(out):
                    time.sleep(0.01)
            process.send_signal(signal.SIGKILL)
        assert process.returncode == -signal.SIGKILL, "it ended before it was killed"
        done.append(points_on_disk(out))
        assert status_lines(status(out))[0].startswith(f"{out}: {done[-1]} of ")
    assert done == sorted(done), "a kill has cost finished points"
    assert 0 < done[0] <= done[-1] < finished(others[kind])
    cube = MAKERS[kind](out, workers=2)
    assert_same(cube, others[kind])
    assert_same(dimersweep.open_cube(out), others[kind])
    assert os.listdir(tmp_path) == ["cube.nc"]


def test_a_search_and_a_map_extend_others(others, tmp_path):
    fewer = SEARCHED | {"Gamma": SEARCHED["Gamma"][::2], "f": SEARCHED["f"][1:]}
    search(fewer, **SEARCH, progress=False, out=tmp_path / "fewer.nc")
    assert_same(MAKERS["search"](tmp_path / "cube.nc", extend=tmp_path / "fewer.nc"), others["search"])
    declared = read_declaration(SMALL_MAP)
    declared.refine.halvings = {"Gamma": 2}
    make(declared, tmp_path / "coarser.nc", progress=False)
    assert_same(MAKERS["map"](tmp_path / "map.nc", extend=tmp_path / "coarser.nc"), others["map"])


def finished(cube):
    """Number of points that were run."""
    return int((cube["computed"] == 1).sum()) if "computed" in cube else cube["mode"].size
