"""What people run, as rows of parameters: a sample of the declared sweeps, and the scenes of ``speed.py``."""

from typing import Any, NamedTuple

import numpy as np
from speed import ROOT
from speed import SCENES as SPEED

from dimersweep.cubes.grid import axis
from dimersweep.kernel.model.layout import ROW
from dimersweep.parameters import Parameters
from dimersweep.studies import declaration

POINTS = 40  # of each declared sweep, spread evenly
FULL = {"basins": ("basins_Gamma", "basins_e"), "fig07": ("fig07",)}
FULL_POINTS = 150
LONG = 100  # forcing periods of a scene to its verdict


class Runs(NamedTuple):
    """Runs that are asked for alike."""

    rows: list[list[float]]
    periods: int
    rtol: float
    settle: bool


def sampled(name: str, points: int) -> Runs:
    """Points of a declared sweep, evenly spread over all of them."""
    plan = declaration.read_declaration(ROOT / "sweeps" / f"{name}.toml")
    grid = plan.study().grid
    asked, rows = plan.sweep, grid.rows_at(np.unique(np.linspace(0, grid.size - 1, points).astype(int)))
    if plan.search is not None:  # its rows leave out the value that is sought
        values = axis(plan.search.over, plan.grid[plan.search.over])
        rows[:, ROW.index(plan.search.over)] = values[np.linspace(0, values.size - 1, len(rows)).astype(int)]
    return Runs(rows.tolist(), asked.periods, asked.rtol, True)


def scene_runs(scenes: dict[str, dict[str, float]], **asked: Any) -> Runs:
    """Each of the scenes."""
    return Runs([Parameters(**scene).row().tolist() for scene in scenes.values()], **asked)


def workload(points: int = POINTS, full_points: int = FULL_POINTS) -> dict[str, list[Runs]]:
    """The runs of each group."""
    small = sorted(path.stem for path in (ROOT / "sweeps").glob("*-small.toml"))
    groups = {"small presets": [sampled(name, points) for name in small]}
    groups |= {group: [sampled(name, full_points) for name in names] for group, names in FULL.items()}
    groups["speed.py"] = [scene_runs(SPEED, periods=LONG, rtol=1e-8, settle=False)]
    return groups
