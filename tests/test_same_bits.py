"""The same cube bit for bit: serial, in threads, on four processes, in two tilings, and after five kills at random moments."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from fakes import set_pace
from sweeper import GRID, SETTINGS

import dimersweep
from dimersweep.cube import build
from dimersweep.manifest import read_manifest
from dimersweep.provenance import attributes
from dimersweep.tiles import Tile, make_spec, run_tile

ROOT = Path(__file__).parents[1]
pytestmark = [pytest.mark.jit, pytest.mark.slow]


def bits(cube):
    """Every byte, type and attribute of the variables of a cube, and the configuration."""
    told = {
        name: (
            variable.dims,
            variable.dtype.str,
            variable.values.tobytes(),
            {k: str(v) for k, v in variable.attrs.items()},
        )
        for name, variable in cube.variables.items()
    }
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
    spec = make_spec(GRID, **SETTINGS)
    results = run_tile(spec, Tile(0, spec.grid.size))
    cube = build(spec.grid, results["out"], results["codes"], attributes(spec.configuration(), "serial", 0))
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
    monkeypatch.setattr("dimersweep.zarrs.CHUNK_POINTS", 130)
    assert_same(swept(out=tmp_path / "cube.zarr"), serial)
    assert os.listdir(tmp_path) == ["cube.zarr"]


def test_four_processes(serial, tmp_path):
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=4, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        assert_same(swept(client=client, out=tmp_path / "cube.nc"), serial)
        assert_same(swept(client=cluster.scheduler_address), serial)


def start(out, workers):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(ROOT / "tests" / "sweeper.py"), str(out), str(workers), "0.05"]
    return subprocess.Popen(command, env=environment, cwd=out.parent)


def finished_points(out):
    manifest = out.with_name("cube.nc.tiles") / "manifest.jsonl"
    return sum(entry.points for entry in read_manifest(manifest).entries) if manifest.exists() else 0


def test_five_kills_at_random_moments(serial, tmp_path):
    out, chance = tmp_path / "cube.nc", random.Random(5)
    done = []
    for kill in range(5):
        with start(out, workers=1 + kill % 3) as process:
            while not out.with_name("cube.nc.tiles").exists():
                time.sleep(0.01)
            if kill:  # at least one after the first tiles, the others anywhere
                time.sleep(chance.uniform(0.0, 1.5))
            else:
                while not finished_points(out):
                    time.sleep(0.01)
            process.send_signal(signal.SIGKILL)
        assert process.returncode == -signal.SIGKILL, "the sweep ended before it was killed"
        done.append(finished_points(out))
    assert done == sorted(done), "a kill has cost finished points"
    assert 0 < done[0] <= done[-1] < serial["mode"].size
    cube = swept(out=out, workers=2)
    assert_same(cube, serial)
    assert_same(dimersweep.open_cube(out), serial)
    assert os.listdir(tmp_path) == ["cube.nc"]
