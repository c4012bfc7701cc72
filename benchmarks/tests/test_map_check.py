"""The check of a refined map finds what differs from brute force."""

import sys
from pathlib import Path

import numpy as np
import pytest
import refinement

import dimersweep
from dimersweep.kernel.model.layout import M_DRIFT, M_REST
from dimersweep.studies.datasets import make
from dimersweep.studies.declaration import read_declaration
from tests.fakes import banded_kernel

MAP = """
[sweep]
title = "bands"
periods = 5
max_periods = 10
output = "map.nc"
[grid]
e = { start = 0.4, stop = 0.8, num = 5 }
Gamma = { start = 0.5, stop = 1.5, num = 6 }
beta0 = { start = 0.05, stop = 1.0, num = 20 }
[search]
over = "beta0"
[refine]
halvings = { e = 2, Gamma = 6 }
between = ["drift", "rest"]
"""


@pytest.fixture(autouse=True)
def bands(monkeypatch, tmp_path):
    monkeypatch.setattr("dimersweep.work.tiles.run_many", banded_kernel)
    monkeypatch.chdir(tmp_path)
    Path("map.toml").write_text(MAP)


def check(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["refinement.py", *arguments])
    with pytest.raises(SystemExit) as ended:
        refinement.main()
    return capsys.readouterr().out, ended.value.code


def test_every_cell_of_a_sound_map_agrees(monkeypatch, capsys):
    told, code = check(monkeypatch, capsys, "map.toml", "--halvings", "e=1", "Gamma=6", "--out", "grid.nc")
    assert not code and "map of 9 x 321 points" in told and "2889 of 2889 points agree" in told
    modes = dimersweep.open_cube("grid.nc")["mode"].values
    runs, whole = (
        int(told.split(start)[1].split()[0].strip(":")) for start in ("the map took ", "the whole grid takes ")
    )
    assert whole == modes.size and runs < 0.1 * whole
    first = sum(next((k + 1 for k, mode in enumerate(row) if mode == M_DRIFT), 20) for row in modes.reshape(-1, 20))
    assert f"the grid takes {first}:" in told
    _, code = check(monkeypatch, capsys, "map.toml", "--halvings", "Gamma=1")
    assert code, "a coarse map takes more than a tenth"


@pytest.mark.parametrize("points", ["all", "700"])
def test_a_wrong_cell_is_found(monkeypatch, capsys, points):
    cube = make(read_declaration("map.toml"), Path("map.nc"), progress=False)
    assert not check(monkeypatch, capsys, "map.nc", "--points", points)[1]
    cube["region"].values[8:, :160] = np.where(cube["region"].values[8:, :160] == M_REST, M_DRIFT, M_REST)
    monkeypatch.setattr("refinement.dimersweep.open_cube", lambda path: cube)
    told, code = check(monkeypatch, capsys, "map.nc", "--points", points)
    assert code and "differs at [" in told
