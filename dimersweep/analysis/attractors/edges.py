"""Edges of basins: the start at which the mode that a run comes to changes, and the motion that it stays near."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import dropwhile
from typing import Any

import numpy as np

from dimersweep.analysis.orbits.continuation.following import traced
from dimersweep.analysis.orbits.continuation.kinds import FOLD
from dimersweep.analysis.orbits.continuation.steps import halved
from dimersweep.analysis.orbits.map.finding import centred, checked, first_map, of_run
from dimersweep.analysis.orbits.map.lost import attempt
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit, orbit_of
from dimersweep.analysis.orbits.map.solution import solve
from dimersweep.errors import OrbitError, ParameterError
from dimersweep.inputs import as_number, check_count, number, pair_of
from dimersweep.kernel.model.layout import D1, D2, N1, N2, PERIOD, PHASE
from dimersweep.parameters import check_name, spelt_out
from dimersweep.runs.run import Run
from dimersweep.runs.simulating import simulate
from dimersweep.symbols import PARAMETERS

EDGE_KNOWN = 1e-10  # accuracy of an edge by default, in the unit of its axis
# change of gaps and rates in a period, in g/omega^2 and g/omega, below which a motion is near a periodic one
NEAR_PERIODIC = 0.3
# number of starts on each side of an edge at each distance, and of distances, that decide whether the edge is clean
STARTS_BESIDE, SCALES = 6, 4
# number of starts, and their distances from neighbours in shares of the interval, for the uncertainty exponent
PROBES, DISTANCES = 60, (1e-3, 1e-4, 1e-5, 1e-6)


@dataclass(frozen=True, kw_only=True)
class Edge:
    """A start at which the fate of runs changes, that is, the mode of motion that they come to.

    Attributes
    ----------
    axis : str
        Parameter of the start that was halved.
    value : float
        Middle of `bracket`, in the unit of the axis.
    bracket : tuple of float
        Values of the axis on both sides of the edge.
    fates : tuple of str
        Modes that runs from the ends of the bracket come to.
    near : PeriodicOrbit or None
        Periodic motion that a start on the edge stays near for longest; None if it stays near none.
    stays : int
        Forcing periods for which the start stays near this motion.
    partner : bool or None
        True if this motion is the unstable partner of a fold: followed down in Gamma, it turns round into a stable one.
    clean : bool
        True if all starts tried beside the edge share the fate of their side.
    exponent : float
        Uncertainty exponent of an edge that is not clean, else NaN. The share of starts whose fate is uncertain falls
        with this power of the accuracy to which a start is known.
    runs : int
        Number of runs that the edge took.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> orbits.edge("beta0", (0.24, 0.28)).fates
    ('rest', 'drift')
    """

    axis: str
    value: float
    bracket: tuple[float, float]
    fates: tuple[str, str]
    near: PeriodicOrbit | None
    stays: int
    partner: bool | None
    clean: bool
    exponent: float
    runs: int


def edge(
    axis: str,
    between: tuple[float | str, float | str],
    *,
    periods: int = 300,
    rtol: float = 1e-11,
    within: float = EDGE_KNOWN,
    **parameters: float,
) -> Edge:
    """Find the edge between two fates of a start, by halving a parameter of the start.

    Parameters
    ----------
    axis : str
        Parameter that is halved: beta0, xdot0, phi0 or any other.
    between : tuple of float or str
        Two values of it that lead to different modes of motion.
    periods : int
        Largest number of forcing periods of a run.
    rtol : float
        Accuracy of the runs [1].
    within : float
        Width to which the bracket is halved, in the unit of the axis.
    **parameters : float
        Parameters of the model; by default the paper's base case.

    Returns
    -------
    Edge

    Raises
    ------
    ParameterError
        For an unknown parameter, or two starts with one fate.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> found = orbits.edge("beta0", (0.24, 0.28))  # rest on one side of it, drift on the other
    >>> round(found.value, 3)
    0.267
    """
    check_name(axis)
    parameters = spelt_out(parameters, {axis: None})
    both = pair_of("between", between, "two values")
    ends = low, high = number(axis, both[0]), number(axis, both[1])
    given: dict[str, Any] = checked(parameters | {axis: low})
    checked(parameters | {axis: high})
    within = as_number("within", within, PARAMETERS[axis].units)
    how: dict[str, Any] = {"periods": check_count("periods", periods), "rtol": rtol}

    @cache
    def fate(value: float) -> str:
        return simulate(**given | {axis: value}, **how, record=False, stop_when_settled=True).mode

    if fate(low) == fate(high):
        raise ParameterError(f"between = ({low:g}, {high:g}): both lead to {fate(low)}; must lead to different motions")
    wide = high - low
    low, high = halved(fate, low, high, within)
    near, stays = _stays_near([simulate(**given | {axis: value}, **how) for value in (low, high)])
    clean = _clean(fate, low, high, wide)
    return Edge(
        axis=axis,
        value=0.5 * (low + high),
        bracket=(low, high),
        fates=(fate(low), fate(high)),
        near=near,
        stays=stays,
        partner=_is_partner(near) if near is not None else None,
        clean=clean,
        exponent=float("nan") if clean else uncertainty(fate, *sorted(ends)),
        runs=fate.cache_info().currsize,
    )


def _clean(fate: Callable[[float], str], low: float, high: float, wide: float) -> bool:
    """Return True if starts beside an edge, up to a hundredth of the interval from it, share the fate of their side."""
    distances = np.geomspace(max(10 * abs(high - low), 1e-6 * abs(wide)), 1e-2 * abs(wide), SCALES)
    aside = np.sign(wide) * np.outer(distances, np.linspace(0.3, 1.0, STARTS_BESIDE)).ravel()
    return all(fate(low - by) == fate(low) and fate(high + by) == fate(high) for by in aside.tolist())


def uncertainty(fate: Callable[[float], str], low: float, high: float) -> float:
    """Return the uncertainty exponent of fates in an interval (McDonald et al., doi 10.1016/0167-2789(85)90001-6)."""
    starts = np.random.default_rng(0).uniform(low, high, PROBES)
    kept: list[tuple[float, float]] = []
    for distance in DISTANCES:
        by = distance * (high - low)
        share = float(np.mean([fate(x) != fate(x + by) or fate(x) != fate(max(low, x - by)) for x in starts]))
        kept += [(distance, share)] if share > 0 else []
    if len(kept) < 2:
        return 1.0
    x, y = np.log(np.array(kept)).T
    return float(np.polyfit(x, y, 1)[0])


def _stays_near(runs: list[Run]) -> tuple[PeriodicOrbit | None, int]:
    """Return the periodic motion that two runs stay near before they part, and the number of forcing periods."""
    ends = [_strobes(run) for run in runs]
    count = min(map(len, ends))
    together = np.abs(ends[0][:count, :4] - ends[1][:count, :4]).max(axis=1) < NEAR_PERIODIC
    parts = count if together.all() else int(np.argmin(together))
    change = np.abs(np.diff(ends[0][: parts + 1, :4], axis=0)).max(axis=1)
    if not change.size:
        return None, 0
    stillest = int(np.argmin(change))
    near = np.concatenate([[False], change < NEAR_PERIODIC, [False]])
    first = stillest - int(np.argmin(near[stillest::-1]))  # just before the stretch of periods near the motion
    last = stillest + 1 + int(np.argmin(near[stillest + 1 :]))  # just after the stretch
    return _orbit_at(runs[0], int(ends[0][stillest, 4])), max(1, last - first - 1)


def _strobes(run: Run) -> np.ndarray:
    """Return a row for each start of a forcing period but the first, shape (n, 5).

    It has the gaps in g/omega^2, their rates in g/omega, and the number of the segment that begins there.
    """
    segments = run.record("edge").segments
    (rows,) = np.nonzero((segments[:, PHASE] == 0.0) & (segments[:, PERIOD] > 0))
    omega = 2 * np.pi * run.parameters["f"]
    v = run.parameters["g"] / omega
    return np.column_stack([segments[rows][:, [D1, D2]] * omega / v, segments[rows][:, [N1, N2]] / v, rows])


def _orbit_at(run: Run, number: int) -> PeriodicOrbit | None:
    """Find the orbit near the beginning of a segment of a run, which begins with a period; return None without one."""

    def found() -> PeriodicOrbit:
        m, z = of_run(run, first_map(run.parameters), number)
        return orbit_of(centred(solve(m, z, m.passage(z).spin)))

    return attempt(found)


def _is_partner(orbit: PeriodicOrbit) -> bool:
    """Return True if an orbit is the unstable partner of a fold.

    It has one multiplier above 1 and, followed down in Gamma, turns round at a fold into a stable orbit.
    """
    if (np.abs(orbit.multipliers) > 1).sum() != 1 or orbit.multipliers[0].real < 1:
        return False
    with suppress(OrbitError):
        rows, _, _ = traced(orbit, "Gamma", 0.5 * orbit.parameters["Gamma"], sequences=False)
        beyond = list(dropwhile(lambda row: row[1].kind is not FOLD, rows))[1:]
        return any(orbit.stable for orbit, _ in beyond)
    return False
