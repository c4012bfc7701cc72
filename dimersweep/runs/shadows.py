"""Estimate how sure a run is, from its shadows: the same run at another accuracy, or from a start beside the given one.

The error of a recorded run is estimated by the differences of its shadows. It falls in proportion to rtol, and the time
of a run grows by a tenth for a digit. So the difference to a much finer run is the error itself, but for a per cent. A
shadow from a nudged start adds what rounding has grown to, which a finer rtol does not cure.

A verdict has two shadows: one run with more digits, and one with fewer digits from a start beside it. If one of them
comes to another mode, a change of the verdict is that near. If both come to the same mode but settle in another period,
their transients were others, and the mode is luck. A motion that has not settled has no certain verdict: chaos may end
after any time.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from dimersweep.cubes.cube import OF_A_RUN, Column, column, finished, names, table
from dimersweep.cubes.seen_run import SeenRun
from dimersweep.inputs import RTOL_RANGE
from dimersweep.kernel.batch import Workspace
from dimersweep.kernel.model.layout import (
    BOTH_DOWN,
    CODE_MODE,
    CODE_N_PERIODS,
    M_DRIFT,
    M_FLUTTER,
    M_JUMP,
    M_PERIOD_N,
    N_ORBIT,
    OUT,
    ROW,
    V_PERIOD,
    V_PHASE,
    V_RADIUS,
    V_ZETA,
)
from dimersweep.parameters import moved_on, value_of
from dimersweep.runs.solving import RunSettings, run_all_patiently
from dimersweep.symbols import EVENT_QUANTITIES, START, STATE_QUANTITIES, Quantity

FINEST_SHADOW, COARSEST_SHADOW = RTOL_RANGE
SHADOW_FINER = 1e-2  # rtol of a shadow over that of the run: its own error is 1 % of the difference
# rtol of a shadow over that of the run if no much finer run is possible: the difference is then the error of the
# shadow, ten times that of the run
SHADOW_COARSER = 10.0
LOOSER, LOOSE = 1e2, 1e-6  # rtol of a verdict's second shadow over that of the run, and the least such rtol
NUDGE = 1e-4  # change of the start over rtol: far below the error of the run, far above round-off
SAFETY = 10.0  # bound over difference: two runs can be alike by chance
PARTED = 1e2  # growth of a bound from one time to the next that only a parting of run and shadow makes
LEAST_ERROR = 1e-12  # least bound on an error, in units of `ERROR_SCALES`: no number is known better
CERTAIN, UNSURE, CHANGED = 1, 2, 3  # codes of ``cube.FLAGS["confidence"]``
SETTLED_MODES = (*BOTH_DOWN, M_DRIFT, M_JUMP, M_FLUTTER, M_PERIOD_N)
ORBIT = tuple(range(N_ORBIT))
_BY_UNIT = {"m": 0.01, "m s-1": 0.1, "rad": 1.0, "rad s-1": 1.0}
ERROR_SCALES = {
    name: _BY_UNIT[quantity.units]
    for name, quantity in STATE_QUANTITIES.items()
    if quantity.units in _BY_UNIT and name not in ("plate", "phase")
}
# larger for the spinning angle: a ball that rolls turns faster than the rod, by l/r, which is ten in the base case
ERROR_SCALES |= {"gamma": 10.0, "gamma_rate": 100.0}
COORDINATES = ("x1", "y1", "gap_1", "theta", "beta", "gamma")
CLOSED_STATE = COORDINATES + tuple(f"{name}_rate" for name in COORDINATES)
SORT = ["cause", "kind", "which"]  # columns that two events must share to be compared


def shadow_starts(
    rtol: float, parameters: Mapping[str, float], start: Mapping[str, float] | None
) -> tuple[float, list[tuple[dict[str, float], dict[str, float] | None]]]:
    """Return the accuracy of the shadows of a run, and their two starts: that of the run, and one beside it.

    `rtol` is the accuracy of the run, `start` its state to start from; it is None if `parameters` give the start.
    """
    by = NUDGE * rtol
    given = {name: value for name, value in parameters.items() if start is None or name not in START}
    as_it = None if start is None else dict(start)
    return shadow_rtol(rtol), [(given, as_it), (nudged(given, by), as_it and nudged_state(as_it, by))]


def shadow_rtol(rtol: float) -> float:
    """Return the accuracy of the shadows of a run with accuracy `rtol`."""
    return SHADOW_FINER * rtol if SHADOW_FINER * rtol >= FINEST_SHADOW else SHADOW_COARSER * rtol


def nudged(given: Mapping[str, Any], by: float) -> dict[str, Any]:
    """Return parameters, numbers or columns, of a start beside the given one.

    The plate is later by `by` radians, `beta0` is smaller and all other numbers of the start but the heading are larger
    by the share `by`.
    """
    moved = moved_on(given, by)
    # the dip angle becomes smaller, as a larger one may be beyond a right angle
    changed = {name: 1 - by if name == "beta0" else 1 + by for name in START if name != "theta0"}
    return moved | {name: given[name] * factor for name, factor in changed.items() if name in given}


def nudged_state(start: Mapping[str, float], by: float) -> dict[str, float]:
    """Return a state to start from in which the rates that no contact ties are larger by the share `by`."""
    faster = ("x1_rate", "y1_rate", "theta_rate", "gamma_rate")
    return {name: value * (1 + by if name in faster else 1.0) for name, value in start.items()}


def pairs(events: xr.Dataset, others: xr.Dataset, T: float) -> tuple[np.ndarray, np.ndarray]:
    """Match the events of two lists: pairs of one cause and kind, each the other's nearest in time.

    No pair is further apart than half the way to the next event of its sort, or half a forcing period `T`.

    Returns
    -------
    rows, other_rows : ndarray, shape (n,), int
        Rows of the pairs in `events` and in `others`.
    """
    ours, theirs = _sorted_out(events, T), _sorted_out(others, T)
    near = {"on": "time", "by": SORT, "direction": "nearest", "suffixes": ("", "_there")}
    found = pd.merge_asof(ours.assign(at=ours["time"]), theirs.assign(at=theirs["time"]), **near).dropna()
    back = pd.merge_asof(theirs, ours, **near)["row_there"]
    row, there = found["row"].to_numpy(), found["row_there"].to_numpy(int)
    close = 2 * (found["at"] - found["at_there"]).abs() <= found[["room", "room_there"]].min(axis=1)
    same = close.to_numpy() & (back.to_numpy()[there] == row)
    return row[same], there[same]


def _sorted_out(events: xr.Dataset, T: float) -> pd.DataFrame:
    """Return a table of events with the columns that `pairs` compares: time, cause, kind, which, room and row.

    `which` numbers the events of one cause and kind that happen at one time. `room` is the time to the nearest event
    with the same cause, kind and `which`, at most `T` [s]. `row` is the row of the event in `events`.
    """
    table = events[["time", "cause", "kind"]].to_dataframe().reset_index(drop=True)
    table["which"] = table.groupby(["time", "cause", "kind"]).cumcount()
    times = table.groupby(SORT)["time"]
    table["room"] = pd.concat([times.diff(), -times.diff(-1)], axis=1).min(axis=1).fillna(T).clip(upper=T)
    return table.assign(row=table.index)


def difference(run: SeenRun, other: SeenRun, times: np.ndarray) -> dict[str, np.ndarray]:
    """Return the distance of the states of two runs at `times`, for each quantity of `ERROR_SCALES`, shape (n,).

    All are inf if `other` failed.
    """
    if other.status != "ok":
        return dict.fromkeys(ERROR_SCALES, np.full(times.size, np.inf))
    ours, theirs = run.states(times), other.states(times)
    return {name: np.abs(ours[name].values - theirs[name].values) for name in ERROR_SCALES}


def delays(run: SeenRun, other: SeenRun) -> np.ndarray:
    """Return the distance in time of each event of `run` from the same event of `other` [s].

    It is NaN where `other` lacks the event.
    """
    rows, other_rows = pairs(run.events, other.events, 1 / run.parameters["f"])
    apart = np.full(run.events.sizes["event"], np.nan)
    apart[rows] = np.abs(run.events["time"].values[rows] - other.events["time"].values[other_rows])
    return apart


def scaled(errors: dict[str, np.ndarray]) -> np.ndarray:
    """Return the largest error of the coordinates and their rates (`CLOSED_STATE`), in units of `ERROR_SCALES`."""
    return np.max([errors[name] / ERROR_SCALES[name] for name in CLOSED_STATE], axis=0)


def bounds(run: SeenRun, shadows: Sequence[SeenRun], times: np.ndarray, T: float) -> xr.Dataset:
    """Estimate bounds on the errors of a run from its shadows, see `Run.error`.

    Parameters
    ----------
    run : SeenRun
        A recorded run.
    shadows : sequence of SeenRun
        The same run computed otherwise. If one of them failed, no bound is known, and all are inf.
    times : ndarray, shape (n,)
        Times since the start, increasing [s].
    T : float
        Forcing period [s].
    """
    apart = [difference(run, shadow, times) for shadow in shadows]
    # two runs may agree for a moment by chance: the largest difference so far counts
    largest = {name: np.maximum.accumulate(np.max([errors[name] for errors in apart], axis=0)) for name in ERROR_SCALES}
    errors = {name: SAFETY * largest[name] + LEAST_ERROR * scale for name, scale in ERROR_SCALES.items()}
    said = {name: f"bound on the error: {STATE_QUANTITIES[name].long_name}" for name in errors}
    columns = [Column(name, Quantity(STATE_QUANTITIES[name].units, said[name]), each) for name, each in errors.items()]
    late = np.max([delays(run, shadow) for shadow in shadows], axis=0)
    bound = np.where(np.isnan(late), np.nan, SAFETY * np.fmax.accumulate(late) + LEAST_ERROR * T)
    total = scaled(errors)
    parted = (
        "first double impact in which a shadow has another end stick: a slip passes zero, and rtol decides; NaN if none"
    )
    beside = {
        "event_time": column(
            "event", bound, Quantity("s", "bound on the error of the time of the event; NaN where a shadow lacks it")
        ),
        "scaled": column("time", total, "largest bound of the state, in its scales"),
        "slip_undecided": column((), _parting(run, late, total, times), Quantity("s", parted)),
    }
    coordinates = {name: run.events[name].variable for name in ("cause", "kind")}
    coordinates["time"] = column("time", times, EVENT_QUANTITIES["time"])
    made = table((), columns, "time").assign(beside).assign_coords(coordinates)
    return finished(made, f"Bounds on the errors {OF_A_RUN}")


def _parting(run: SeenRun, late: np.ndarray, total: np.ndarray, times: np.ndarray) -> float:
    """Return the time of the double impact that parts the run from a shadow [s]; NaN if there is none.

    There a slip passes zero, and friction holds it in one of them alone. This takes a stick friction above the slip
    friction. Events that only one of the two has may also be hops of a chatter, which part nothing: after a parting the
    errors grow at once.
    """
    holds = any(value_of(f"mu_s_{end}", run.parameters) > value_of(f"mu_{end}", run.parameters) for end in (1, 2))
    both_hit = np.char.startswith(names(run.events)["kind"].values.astype(str), "DI")
    for time in run.events["time"].values[np.isnan(late) & both_hit] if holds else ():
        after = int(np.searchsorted(times, time))
        if 0 < after < times.size and total[after] > PARTED * total[after - 1]:
            return float(time)
    return np.nan


def certified(
    rows: np.ndarray, how: RunSettings, out: np.ndarray, codes: np.ndarray, space: Workspace | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Judge the verdicts of points by shadows: the confidence in their modes, and the errors of their orbits.

    Parameters
    ----------
    rows : ndarray, shape (n, N_ROW), float64
        Kernel rows of the points.
    how : RunSettings
        Settings of their runs. The shadows have the same, but for the accuracy.
    out, codes : ndarrays, shapes (n, N_OUT), (n, N_CODES)
        Results of their runs.
    space : Workspace, optional
        Scratch arrays.

    Returns
    -------
    confidence : ndarray, shape (n,), int64
        CERTAIN, UNSURE or CHANGED.
    error : ndarray, shape (n,), float64
        Largest relative difference of an orbit's quantities from those with more digits; for zeta and the impact phase
        the absolute difference. NaN where the mode is not drift in both runs.
    """
    confidence = np.where(np.isin(codes[:, CODE_MODE], SETTLED_MODES), CERTAIN, UNSURE)
    error = np.full(len(rows), np.nan)
    finer = max(SHADOW_FINER * how.rtol, FINEST_SHADOW)
    looser = min(max(LOOSER * how.rtol, LOOSE), COARSEST_SHADOW)
    # the finer shadow starts aside by no more than round-off, the looser one by its own accuracy
    for shadow_rtol, nudge in ((finer, LEAST_ERROR), (looser, looser)):
        left = np.flatnonzero(confidence == CERTAIN)
        moved = nudged(dict(zip(ROW, rows[left].T, strict=True)), nudge)
        nudged_rows = np.column_stack([moved[name] for name in ROW])
        shadow = run_all_patiently(nudged_rows, how._replace(rtol=shadow_rtol), space)
        confidence[left] = compared((out[left], codes[left]), shadow)
        if shadow_rtol == finer:
            error[left] = orbit_difference(out[left], shadow[0])
    return confidence, error


def compared(results: tuple[np.ndarray, np.ndarray], shadow: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the confidence in the modes of points from their results and those of their shadows, shape (n,).

    It is CHANGED where the modes differ, UNSURE where the same mode was settled in another period or after another
    length of run, else CERTAIN.
    """
    (out, codes), (other_out, other_codes) = results, shadow
    ended = codes[:, CODE_N_PERIODS] == other_codes[:, CODE_N_PERIODS]
    after, other_after = (numbers[:, OUT.index("settled_after")] for numbers in (out, other_out))
    # NaN: a motion at rest has no period in which it settled
    alike = ended & ((after == other_after) | np.isnan(after))
    return np.where(codes[:, CODE_MODE] != other_codes[:, CODE_MODE], CHANGED, np.where(alike, CERTAIN, UNSURE))


def orbit_difference(out: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return, for each of n points, the largest difference of a quantity of its orbit between two results, shape (n,).

    Differences are relative to `out` (to `other` where `out` is 0); those of zeta and the impact phase are absolute.
    The largest one is NaN where one of both results has no orbit, or where only one of both paths is straight.
    """
    ours, theirs = out[:, ORBIT], other[:, ORBIT]
    apart = np.abs(ours - theirs)
    apart[:, V_PHASE] = np.minimum(apart[:, V_PHASE], 1 - apart[:, V_PHASE])  # a phase of 1 is that of 0
    scale = np.where(ours == 0.0, np.abs(theirs), np.abs(ours))
    scale[:, [V_ZETA, V_PHASE]] = 1.0
    straight = np.isnan([ours[:, V_RADIUS], theirs[:, V_RADIUS]]).all(0) & np.isfinite(ours[:, V_ZETA])
    apart[np.ix_(straight, [V_RADIUS, V_PERIOD])] = 0.0  # two straight paths have neither
    scale[apart == 0.0] = 1.0  # both may be 0, as the precession rate of a straight path
    return np.asarray(np.max(apart / scale, axis=1))
