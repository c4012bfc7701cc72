"""Runs, orbits and cubes as small tables of HTML, for notebooks."""

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
    """What a run is, besides its mode: parameters unlike the base case, its orbit with units; what its words mean."""
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
    """Numbers of an orbit by their names, with units."""
    values = {name: getattr(orbit, name) for name in shown}
    return [
        (
            name.replace("_", " "),
            "none: straight" if np.isnan(value) else f"{value:.6g} {units_shown(QUANTITIES[name].units)}",
        )
        for name, value in values.items()
    ]


def orbit_table(orbit: Any) -> str:
    """What a `PeriodicOrbit` is: its parameters but for a start, its numbers, its stability and its sequence."""
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
    """What a run is: its mode and what that means, and all of `run_rows`."""
    rows = [("", meanings(run)[run.mode]), *run_rows(run)]
    return _table(f"Run: {_badge(run.mode)}{escape(repeats_in(run))}", rows)


def repeats_in(run: SeenRun) -> str:
    """In how many periods a motion repeats, as it is said behind its mode, if they are more than one."""
    return f", repeats every {run.mode_period} periods" if run.mode_period > 1 else ""


def cube_table(cube: xr.Dataset) -> str:
    """What a cube is: its title, its axes, its fixed parameters, and how often each mode occurs."""
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
    """What a mode of ends that stay down means in a cube: how fast the dimer rolls or slides on."""
    if word not in DOWN_WORDS:
        return ""
    speeds = cube["speed"].values[(cube["mode"].values == MODES.index(word)) & np.isfinite(cube["speed"].values)]
    moves = f", the centre of mass moves at {speeds.min():.3g} to {speeds.max():.3g} m/s" if speeds.size else ""
    return f": both ends stay down{moves}"


def title_as_html(cube: xr.Dataset) -> str:
    """The title of a cube, in which nothing is markup: a file may bring any."""
    return escape(str(cube.attrs.get("title", "cube of dimersweep")))


def _badge(mode: str) -> str:
    color = MODE_COLORS[mode]
    return f'<span style="border-left: 0.8em solid {color}; padding-left: 0.3em">{escape(mode)}</span>'


def _table(heading: str, rows: Iterable[tuple[str, str]]) -> str:
    cell = 'style="text-align: left; padding: 0 1em 0 0"'
    body = "".join(f"<tr><td {cell}>{escape(name)}</td><td {cell}>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table><caption style='text-align: left'><b>{heading}</b></caption>{body}</table>"
