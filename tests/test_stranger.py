"""What a stranger does in the first hour, in 25 lines."""

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.jit
SCRIPT = """
import dimersweep
from scipy.stats import qmc

run = dimersweep.simulate(Gamma=0.9, f=15, beta0="16 deg", periods=100)
print(run)
run.save("run.nc")
run = dimersweep.load_run("run.nc").go_on(100)
run.animate("run.gif", periods=2)
run.plot("run.png")
faster = dimersweep.simulate(start=run, Gamma=1.0, periods=50)
print(faster.section()["theta_rate"].values[-1])

names, low, high = ("Gamma", "f", "beta0"), (0.7, 10, 0.05), (1.2, 30, 1.0)
sample = qmc.scale(qmc.LatinHypercube(3, seed=1).random(500), low, high)
cube = dimersweep.sweep(points=dict(zip(names, sample.T)), periods=100, out="points.nc")
print(cube.dimersweep)
print(cube["radius"].where(cube.dimersweep.drifts()).mean())
cube.dimersweep.plot(path="points.png")
print(cube.dimersweep.run(point=7))

diagram = dimersweep.bifurcation({"Gamma": {"start": 0.6, "stop": 2.0, "num": 60}}, periods=100, strobes=32)
diagram.dimersweep.plot(path="diagram.png")
"""


def test_the_first_hour_of_a_stranger(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert len([line for line in SCRIPT.splitlines() if line]) <= 25
    exec(compile(SCRIPT, "stranger", "exec"), {})
    out = capsys.readouterr().out
    assert out.startswith("<Run: ok, drift, radius ")
    assert re.search(r"<cube of dimersweep over point \(500\): ", out)
    assert {path.name for path in Path().iterdir()} == {
        *("run.nc", "run.gif", "run.png", "points.nc", "points.png", "diagram.png"),
    }
