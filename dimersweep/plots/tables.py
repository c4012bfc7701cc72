"""Show runs, orbits and cubes as small tables of HTML, for notebooks."""

from collections.abc import Iterable
from html import escape
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.seen_run import SeenRun, meanings
from dimersweep.kernel.model.layout import DOWN_WORDS, MODES
from dimersweep.plots.style import MODE_COLORS, fixed_of, percent
from dimersweep.storage.cubefiles import modes_in
from dimersweep.symbols import PARAMETERS, QUANTITIES, START, conditions, symbol, units_shown, value_shown

SHOWN_OF_ORBIT = ("radius", "path_radius", "period", "zeta", "speed", "impact_phase")


def run_rows(run: SeenRun) -> list[tuple[str, str]]:
    """Return the rows of a run's table, by name, without its mode.

    They are parameters that differ from the base case, numbers of the run and its orbit with units, and meanings of its
    words.
    """
    rows = [
        ("parameters", run.conditions(always=()) or "the base case"),
        ("periods", f"{run.n_periods} of {1 / run.parameters['f']:.4g} s"),
        ("events", f"{run.n_events}" + (f" ({run.record_cut})" if run.record_cut else "")),
    ]
    if run.status != "ok":
        rows.append(("status", f"{run.status}: {run.message}"))
    if run.orbit:
        rows += _numbers(run.orbit, SHOWN_OF_ORBIT)
    elif run.mode in DOWN_WORDS:
        rows.append(("both ends stay down", f"the centre of mass moves at {run.end_speed:.3g} m/s"))
    return rows + list(meanings(run).items())[1:]


def _numbers(orbit: Any, shown: Iterable[str]) -> list[tuple[str, str]]:
    """Return the numbers `shown` of an orbit by their names, with units."""
    values = {name: getattr(orbit, name) for name in shown}
    return [
        (
            name.replace("_", " "),
            "none: straight" if np.isnan(value) else f"{value:.6g} {units_shown(QUANTITIES[name].units)}",
        )
        for name, value in values.items()
    ]


def orbit_table(orbit: Any) -> str:
    """Return the table of a `PeriodicOrbit`: its parameters but for a start, numbers, stability and sequence."""
    largest = f"{abs(orbit.multipliers[0]):.6g}, the largest of the fast part in size"
    rows = [
        ("parameters", conditions(orbit.parameters, START, always=()) or "the base case"),
        ("repeats after", f"{orbit.periods} of {1 / orbit.parameters['f']:.4g} s"),
        *_numbers(orbit, ("spin", *SHOWN_OF_ORBIT, "path_speed")),
        ("multiplier", largest),
        ("sequence", orbit.sequence),
    ]
    return _table(f"Orbit: {'stable' if orbit.stable else 'unstable'}", rows)


def run_table(run: SeenRun) -> str:
    """Return the table of a run: its mode and the meaning of the mode, and all of `run_rows`."""
    rows = [("", meanings(run)[run.mode]), *run_rows(run)]
    return _table(f"Run: {_badge(run.mode)}{escape(repeats_in(run))}", rows)


def repeats_in(run: SeenRun) -> str:
    """Return the words behind a mode that say in how many periods the motion repeats; "" for one period."""
    return f", repeats every {run.mode_period} periods" if run.mode_period > 1 else ""


def cube_table(cube: xr.Dataset) -> str:
    """Return the table of a cube: its title, its axes, its fixed parameters, and the number of points in each mode."""
    mode = cube["mode"]
    rows = []
    for name, n in mode.sizes.items():
        axis, span = str(name), ""
        if name in PARAMETERS:
            first, last = (value_shown(axis, cube[name].values[k]) for k in (0, -1))
            axis, span = symbol(axis), f" from {first} to {last}"
        rows.append((f"axis {axis}", f"{n} values{span}"))
    rows.append(("fixed", conditions(*fixed_of(cube), PARAMETERS)))
    rows += [(word, f"{n} ({percent(n / mode.size)})" + _speeds(cube, word)) for word, n in modes_in(cube).items()]
    return _table(title_as_html(cube), rows)


def _speeds(cube: xr.Dataset, word: str) -> str:
    """Return a note for the row of a mode in which both ends stay down; "" for any other mode.

    The note has the least and greatest speed of the centre of mass [m/s] over the points of the cube in that mode.
    """
    if word not in DOWN_WORDS:
        return ""
    speeds = cube["speed"].values[(cube["mode"].values == MODES.index(word)) & np.isfinite(cube["speed"].values)]
    moves = f", the centre of mass moves at {speeds.min():.3g} to {speeds.max():.3g} m/s" if speeds.size else ""
    return f": both ends stay down{moves}"


def title_as_html(cube: xr.Dataset) -> str:
    """Return the title of a cube, escaped: a file may have any text there."""
    return escape(str(cube.attrs.get("title", "cube of dimersweep")))


def _badge(mode: str) -> str:
    """Return the HTML of a mode with a bar in its colour."""
    color = MODE_COLORS[mode]
    return f'<span style="border-left: 0.8em solid {color}; padding-left: 0.3em">{escape(mode)}</span>'


def _table(heading: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return the HTML of a table: `heading` is HTML, the names and values in `rows` are texts."""
    cell = 'style="text-align: left; padding: 0 1em 0 0"'
    body = "".join(f"<tr><td {cell}>{escape(name)}</td><td {cell}>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table><caption style='text-align: left'><b>{heading}</b></caption>{body}</table>"
