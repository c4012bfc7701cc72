"""What is refused is told in one line, before any work: calls and lines in ``data/refusals.toml``."""

from functools import partial, reduce
from math import inf, nan, pi
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from dimersweep import (
    attractors,
    bifurcation,
    explore,
    names,
    observer,
    open_cube,
    orbits,
    plots,
    refine,
    search,
    simulate,
    sweep,
)
from dimersweep.analysis.borders.border_files import read_borders
from dimersweep.analysis.fits import Measured, circle, fit
from dimersweep.cubes.findings import exponents
from dimersweep.cubes.grid import make_grid
from dimersweep.errors import UserError
from dimersweep.exploring.page import LivePage
from dimersweep.inputs import check_count, check_rtol
from dimersweep.kernel.model.layout import M_DRIFT
from dimersweep.parameters import Parameters
from dimersweep.plots import draw
from dimersweep.studies.declared import read_declaration
from tests import own_observers
from tests.checks.cubes import cube_of, radii
from tests.checks.data import DATA, data, is_told
from tests.seams import no_work

SWEEPS = Path(__file__).parents[1] / "sweeps"
ROWS = [
    (call, told) for section, rows in data("refusals").items() if section != "commands" for call, told in rows.items()
]


def of_file(read):
    """A reader of the text of a file, in which one place is replaced."""

    def read_changed(text, old="", new=""):
        assert text.count(old) == 1 or not old
        Path("file.toml").write_text(text.replace(old, new))
        return read("file.toml")

    return read_changed


declared, borders = of_file(read_declaration), of_file(read_borders)


def points(*lines):
    """A declaration of points in these lines of a file."""
    return declared("\n".join(['[sweep]\nperiods = 20\noutput = "points.nc"', *lines]))


def table(*lines):
    """A declaration of points that stand in these lines of another file."""
    Path("table.csv").write_bytes("".join(f"{line}\n" for line in lines).encode("latin-1"))
    return points("[points]", 'file = "table.csv"')


# what the calls of the table are made of
WORDS = {
    "np": np, "nan": nan, "inf": inf, "pi": pi, "SimpleNamespace": SimpleNamespace, "Parameters": Parameters,
    "check_rtol": check_rtol, "check_count": check_count, "make_grid": make_grid, "sweep": sweep, "search": search,
    "refine": refine, "bifurcation": bifurcation, "attractors": attractors, "simulate": simulate, "orbits": orbits,
    "fit": fit, "Measured": Measured, "circle": circle, "plots": plots, "draw": draw, "open_cube": open_cube, "names": names,
    "observer": observer, "own": own_observers, "partial": partial,
    "exponents": exponents, "radii": radii, "declared": declared, "borders": borders, "points": points, "table": table,
    "explore": explore, "LivePage": LivePage, "Figure": Figure,
    "NESTED": reduce(lambda inner, _: [inner], range(5000), 1.0),
    "MANY": {"start": 0.1, "stop": 0.9, "num": 10_000},
    "AXES": {"f": [1, 3], "e": [0.5, 0.6], "beta0": [0.1, 0.2]},
    "STARTS": {"beta0": ("1 deg", "60 deg"), "phi0": (0.0, 6.28)},
    "IN_KELVIN": xr.DataArray([0, 1, 2, 3], dims="t", attrs={"units": "K"}),
    "STRIP": cube_of([M_DRIFT, M_DRIFT], {"f": [15, 20]}), "POINT": cube_of([M_DRIFT], {"f": [15]}),
    "SMALL": (SWEEPS / "fig07-small.toml").read_text(), "MAP": (SWEEPS / "fig08-small.toml").read_text(),
    **{name.upper(): (DATA / "borders" / f"{name}.toml").read_text() for name in ("curves", "branches", "families")},
}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("call", "told"), ROWS, ids=[call for call, _ in ROWS])
def test_what_is_not_allowed_is_told_in_one_line_before_any_work(call, told, monkeypatch, empty_folder):
    no_work(monkeypatch)
    with pytest.raises((UserError, TypeError)) as error:
        eval(call, WORDS)
    kind, _, line = told.rpartition("Error: ")
    assert type(error.value).__name__ == f"{kind or 'Parameter'}Error"
    assert "\n" not in str(error.value)
    assert is_told(str(error.value), line)
