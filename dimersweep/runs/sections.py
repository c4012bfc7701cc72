"""Compute sections of a recorded run: its states at the moments that make them points of a map."""

from math import tau
from typing import Literal, get_args

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import column, names
from dimersweep.cubes.seen_run import SeenRun
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number

At = Literal["period", "double_impact", "landing_1", "landing_2"]
SECTIONS: tuple[str, ...] = get_args(At)


def section_of(run: SeenRun, at: At, phase: float | str | None) -> xr.Dataset:
    """Return the states of a run at the moments of a section; see `Run.section`."""
    if at not in SECTIONS:
        raise ParameterError(f"at = {at!r}: must be one of {', '.join(SECTIONS)}")
    if phase is not None and at != "period":
        raise ParameterError(f"phase = {phase}: a section is at a phase, or at = {at!r}")
    at_phase = None if phase is None else as_number("phase", phase, "rad")
    run.record("section")
    f, before = run.parameters["f"], {}
    if at != "period":
        rows = impacts_at(run.events, at)
        times = run.events["time"].values[rows]
        before = {
            name: ("n", variable.values[rows], variable.attrs)
            for name, variable in run.events.items()
            if "before" in str(name) and "gap" in str(name)
        }
    elif at_phase is not None:
        cycles = (at_phase - run.parameters["phi0"]) % tau / tau + np.arange(run.n_periods + 1)
        times = cycles[cycles <= run.n_periods] / f
    else:
        times = np.arange(run.n_periods + 1) / f
    points = run.states(times).swap_dims(time="n").assign(before)
    name = "number of the point" if at != "period" else "forcing periods since the start"
    return points.assign_coords(n=column("n", np.arange(points.sizes["n"]), name))


def impacts_at(events: xr.Dataset, at: str) -> np.ndarray:
    """Return the numbers of the first rows of impacts that begin with both ends on the plate, or in which an end lands.

    An end that lands is in the air before the first row. In a later row of the same impact it may come back after a
    rebound.
    """
    events = names(events)
    (rows,) = np.nonzero((events["cause"] == "impact").values)
    impulses = np.array([events["impulse_1"].values[rows], events["impulse_2"].values[rows]])
    times, begins = np.unique(events["time"].values[rows], return_index=True)
    if not times.size:
        return rows
    firsts, pushes = rows[begins], np.add.reduceat(impulses, begins, axis=1) > 0
    if at == "double_impact":
        return firsts[pushes.any(axis=0) & events["kind"].str.startswith("DI").values[firsts]]
    end = at[-1]
    falls = events[f"gap_{end}_rate_before"].values[firsts] < 0
    was_closed = events["contact_before"].str.startswith((f"SC{end}", "DC")).values[firsts]
    return firsts[pushes[int(end) - 1] & falls & ~was_closed]
