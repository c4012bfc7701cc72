"""Compute the growth of small changes: the Lyapunov exponents of a run, the multipliers of a settled motion.

All functions use the map from one start of a forcing period to the next (`period_map`).
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np

from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count
from dimersweep.kernel.model.layout import DOWN_WORDS, FREE, N_STATE
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES
from dimersweep.parameters import check_level
from dimersweep.runs.period_map import NAMES, Section, free_coordinates
from dimersweep.runs.recorded import RunRecord, period_rows
from dimersweep.runs.run import Run
from dimersweep.runs.tangent import Tangents

LinearMap = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
MAP_RTOL = 1e-11  # coarsest accuracy of the map: differences are taken of its images
# periods before the growth is counted, and one more for each so many that are counted: the change finds its direction
SETTLING, SHARE = 20, 10
FORGOTTEN = NAMES[:5]  # coordinates that keep nothing of the past once both ends have been at rest; the spin rolls on
BLOCKS = 20  # blocks of periods: the spread of their means gives the error of the whole mean
ROUNDING = 100 * np.finfo(float).eps  # relative rounding of a length that is the root of a sum of products


class Multipliers(NamedTuple):
    """Eigenvalues of the return map of a settled motion.

    Attributes
    ----------
    values : ndarray, shape (n,), complex
        Multipliers, the largest in size first: factors by which small changes grow in one period of the motion. The
        motion is stable if all are below 1 in size.
    matrix : ndarray, shape (n, n)
        The derivative of the map.
    coordinates : tuple of str
        Names of the rows and columns: those of `NAMES` that are free in the contact at the start of the period.
    closure : float
        Distance between start and end of one period of the motion, the largest of all coordinates, in their units.

    Examples
    --------
    >>> from dimersweep import simulate, stability
    >>> found = stability.multipliers(simulate(periods=200))
    >>> bool((abs(found.values) < 1).all()), found.matrix.shape  # a stable motion
    (True, (4, 4))
    """

    values: np.ndarray
    matrix: np.ndarray
    coordinates: tuple[str, ...]
    closure: float


class Lyapunov(NamedTuple):
    """Largest Lyapunov exponent of a motion.

    Attributes
    ----------
    exponent, error : float
        Mean growth rate of a small difference, and the standard error of that mean [s-1].
    per_period : float
        The same growth per forcing period [1].
    periods : int
        Forcing periods over which it is averaged: fewer than asked for if chaos has ended before.

    Examples
    --------
    >>> from dimersweep import simulate, stability
    >>> found = stability.lyapunov(simulate(periods=200), periods=100)
    >>> abs(found.per_period) < 1e-4, found.periods  # a settled drift: only its spin drifts slowly
    (True, 100)
    """

    exponent: float
    error: float
    per_period: float
    periods: int

    def __repr__(self) -> str:
        growth = f"exponent {self.exponent:.4g} /s, error {self.error:.2g} /s, {self.per_period:.4g} per forcing period"
        return f"<Lyapunov: {growth}, over {self.periods} of them>"


class Spectrum(NamedTuple):
    """Lyapunov exponents of a motion, the largest first.

    Attributes
    ----------
    exponents, errors : ndarray, shape (n,)
        Mean growth rates of small changes in the n coordinates that are free at the start, and the standard errors of
        these means [s-1]. For a change that a contact or an impact takes away the rate is -inf and its error NaN.
    per_period : ndarray, shape (n,)
        The same growth per forcing period [1].
    periods : int
        Forcing periods over which they are averaged: fewer than asked for if chaos has ended before.

    Examples
    --------
    >>> from dimersweep import simulate
    >>> from dimersweep.runs.growth import spectrum
    >>> found = spectrum(simulate(periods=300), 100)
    >>> found.periods, bool(found.exponents[0] > found.exponents[-1])
    (100, True)
    """

    exponents: np.ndarray
    errors: np.ndarray
    per_period: np.ndarray
    periods: int


def _end(run: Run, wanted: str) -> tuple[RunRecord, np.ndarray, np.ndarray]:
    """Return the record of a run that reached its end, with its last state and friction modes."""
    check_level(run.parameters, wanted)
    record = run.record(wanted)
    if run.status != "ok":
        raise ParameterError(f"{wanted}: the run did not reach its end ({run.message})")
    last = record.segments[-1]
    return record, last[:N_STATE].copy(), last[SEGMENT_MODES:SEGMENT_HOP_TIME].copy()


def multipliers(run: Run) -> Multipliers:
    """Compute the multipliers of the motion that a run has settled to, from central differences of its return map.

    Parameters
    ----------
    run : Run
        A recorded run that has settled: its mode has a period. Let it run long: the multipliers are those of its last
        state.

    Returns
    -------
    Multipliers
        Directions that contact takes away in each period are left out, as their multipliers are zero: gap and gap rate
        of an end on the plate, and the slip of an end that sticks.

    Raises
    ------
    ParameterError
        If the motion has no period, or if a neighbouring motion meets the section in another contact. In the latter
        case the section lies at an event of the motion: shift it with `phi0`.

    Examples
    --------
    >>> from dimersweep import simulate, stability
    >>> found = stability.multipliers(simulate(periods=200))
    >>> found.coordinates
    ('gap_2', 'gap_2_rate', 'turn_rate', 'spin')
    >>> abs(found.values).round(3)  # the first is that of the spin, which drifts slowly
    array([1.   , 0.599, 0.599, 0.307])
    """
    record, state, modes = _end(run, "multipliers")
    if run.mode_period == 0:
        instead = "lyapunov tells its growth" if run.mode == "aperiodic" else "give it more periods"
        raise ParameterError(f"multipliers: the motion does not repeat (mode {run.mode}); {instead}")
    return of_orbit(Section(record.row, min(run.rtol, MAP_RTOL)), state, modes, run.mode_period)


def of_orbit(section: Section, state: np.ndarray, modes: np.ndarray, periods: int) -> Multipliers:
    """Compute the multipliers of the motion that returns to `state`, in contact `modes`, after whole forcing periods.

    See `multipliers` for the errors raised.
    """
    point, free = section.point(state), free_coordinates(modes)
    step = section.rtol ** (1 / 3)  # balances the error of the differences, step^2, with that of the map, rtol/step
    # a free end this near to the plate would touch it in the differences, and so change its contact
    close = any(modes[end] == FREE and point[end] <= 2 * step for end in (0, 1))

    def mapped(by: float, k: int) -> np.ndarray:
        moved = point.copy()
        moved[k] += by
        image, contact = section.after(section.state(moved, modes), periods)
        if close or (contact != modes).any():
            raise ParameterError("multipliers: the section lies at an event of the motion; shift it with phi0")
        return image[free]

    columns = [(mapped(step, k) - mapped(-step, k)) / (2 * step) for k in free]
    matrix = np.array(columns).T
    values = np.linalg.eigvals(matrix).astype(complex)
    order = np.argsort(-np.abs(values), kind="stable")
    closure = float(np.abs(mapped(0.0, 0) - point[free]).max())
    return Multipliers(values[order], matrix, tuple(NAMES[k] for k in free), closure)


def lyapunov(run: Run, periods: int = 1000) -> Lyapunov:
    """Compute the largest Lyapunov exponent of the motion that a run has come to.

    The run is made longer (`Run.go_on`). In each forcing period a twin starts beside it, in the direction that the
    previous twin has taken. The exponent is the mean logarithm of the growth of their difference (Benettin's method).

    Parameters
    ----------
    run : Run
        A recorded run whose transients are over.
    periods : int
        Forcing periods over which the growth is averaged, at most. Before them, 20 and a tenth of that number are run.
        Chaos may end by itself: the motion settles, or both ends come to rest together, and all but the spin is
        forgotten. The count ends there.

    Returns
    -------
    Lyapunov
        For a motion that has settled, the exponent per period is the logarithm of its largest multiplier. It is 0 at
        rest, where the dimer rolls on at a constant speed.

    Raises
    ------
    ParameterError
        If nothing was recorded, the run does not reach its end, or its chaos ends soon after.

    Examples
    --------
    >>> from dimersweep import simulate, stability
    >>> found = stability.lyapunov(simulate(Gamma=3.0, e=0.8, periods=200), periods=130)
    >>> found.exponent > 10 * found.error  # chaos: a small difference grows
    True
    """
    starts = _period_starts(run, periods, "lyapunov")
    step = partial(partial, _from_twin, starts.section, starts.settled)
    maps = map(step, starts.states[:-1], starts.modes[:-1], starts.modes[1:])
    direction, free = np.zeros(len(NAMES)), free_coordinates(starts.modes[0])
    # a random direction has parts in all others, the growing one among them; it is the same in each call
    direction[free] = np.random.default_rng(0).normal(size=len(NAMES))[free]
    growth = qr_growth(maps, direction[None] / np.linalg.norm(direction), fewest=1)
    mean, error, counted = _mean_growth(growth[:, 0], starts, "lyapunov")
    f = run.parameters["f"]
    return Lyapunov(float(mean) * f, float(error) * f, float(mean), counted)


def spectrum(run: Run, periods: int = 200) -> Spectrum:
    """Compute all Lyapunov exponents of the motion that a run has come to.

    The run is made longer (`Run.go_on`). In each forcing period the return map is differentiated in the directions that
    contact leaves free, by central differences whose step is tested. The images of the directions are made orthogonal
    again (doi 10.1007/BF02128237).

    Volumes are those of phase space (`tangent`). Without friction each impact of an end of restitution e contracts them
    by e^2, and nothing else does.

    Parameters
    ----------
    run : Run
        A recorded run whose transients are over.
    periods : int
        As in `lyapunov`. Each takes about forty times as long as a period of the run.

    Returns
    -------
    Spectrum
        For a motion that has settled, the exponents per period are the logarithms of its multipliers.

    Raises
    ------
    ParameterError
        If nothing was recorded, the run does not reach its end, or its chaos ends soon after.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep import simulate
    >>> from dimersweep.runs.growth import multipliers, spectrum
    >>> run = simulate(periods=300)
    >>> print(np.exp(spectrum(run, 100).per_period).round(2), abs(multipliers(run).values).round(2))
    [1.   0.6  0.6  0.31] [1.   0.6  0.6  0.31]
    """
    starts = _period_starts(run, periods, "spectrum")
    tangents = Tangents(starts.section)
    places = [tangents.place(state) for state in starts.states]
    maps = map(partial(partial, tangents.grown), places[:-1], starts.modes[:-1], places[1:])
    # in a chaotic motion that has brought both ends to rest only one direction is left, the spin: its chaos has ended
    growth = qr_growth(maps, tangents.basis(places[0], starts.modes[0]), fewest=0 if starts.settled else 2)
    mean, error, counted = _mean_growth(growth, starts, "spectrum")
    order, f = np.argsort(-mean, kind="stable"), run.parameters["f"]
    return Spectrum(mean[order] * f, error[order] * f, mean[order], counted)


class _PeriodStarts(NamedTuple):
    """States and friction modes of a run that goes on, at the starts of its forcing periods."""

    section: Section
    states: np.ndarray
    modes: np.ndarray
    settled: bool
    before: int  # periods before the count begins
    counted: int  # periods to count


def _period_starts(run: Run, periods: int, wanted: str) -> _PeriodStarts:
    """Make a run longer by the periods before the count, and `periods` to count; return its states there.

    They end where the chaos of the run ends. `wanted` names the caller, for errors.
    """
    _end(run, wanted)
    periods = check_count("periods", periods)
    before = SETTLING + periods // SHARE
    longer = run.go_on(before + periods)
    record, _, _ = _end(longer, wanted)
    settled = run.mode_period > 0 or run.mode in DOWN_WORDS
    rows = record.segments[period_rows(record.segments)][run.n_periods :]
    if not settled and longer.settled_after > run.n_periods:
        rows = rows[: int(longer.settled_after) - run.n_periods + 1]
    section = Section(record.row, min(run.rtol, MAP_RTOL))
    modes = rows[:, SEGMENT_MODES:SEGMENT_HOP_TIME]
    return _PeriodStarts(section, rows[:, :N_STATE], modes, settled, before, periods)


def _mean_growth(growth: np.ndarray, starts: _PeriodStarts, wanted: str) -> tuple[np.ndarray, np.ndarray, int]:
    """Average logarithms of growth along the first axis; return means, their standard errors, and the number counted.

    The first part is left out, in the share of `way.before`. Raise `ParameterError` if too little is left.
    """
    if len(growth) <= SETTLING:
        raise ParameterError(f"{wanted}: the chaos ends {len(growth)} periods after the run; end the run earlier")
    kept = growth[len(growth) * starts.before // (starts.before + starts.counted) :]
    blocks = np.array([block.mean(axis=0) for block in np.array_split(kept, min(BLOCKS, len(kept)))])
    with np.errstate(invalid="ignore"):
        error = (
            np.std(blocks, axis=0, ddof=1) / len(blocks) ** 0.5 if len(blocks) > 1 else np.full(kept.shape[1:], np.nan)
        )
    return kept.mean(axis=0), error, len(kept)


def qr_growth(maps: Iterable[LinearMap], directions: np.ndarray, fewest: int = 0) -> np.ndarray:
    """Compute the logarithms of the growth of orthogonal directions under a sequence of linear maps.

    Parameters
    ----------
    maps : iterable of callable
        Each takes directions, shape (m, k), and returns their images as columns, shape (l, m), and bounds on the errors
        of these, shape (m,).
    directions : ndarray, shape (n, k)
        Orthogonal directions of length 1.
    fewest : int
        The growth ends before the map that leaves fewer directions than this.

    Returns
    -------
    ndarray, shape (number of maps that count, n)
        -inf from the map on that takes a direction away: what the other images leave of its image is below its error.

    Examples
    --------
    >>> import numpy as np
    >>> from dimersweep.runs.growth import qr_growth
    >>> matrix = np.array([[2.0, 1.0], [0.0, 0.5]])
    >>> growth = qr_growth([lambda q: (matrix @ q.T, np.zeros(len(q)))] * 50, np.eye(2))
    >>> print(np.exp(growth.mean(axis=0)).round(3))
    [2.  0.5]
    """
    n = len(directions)
    left, growth = np.arange(n), []
    for each in maps:
        directions, sizes = orthogonal(*each(directions))
        left = left[sizes > 0]
        if left.size < fewest:
            break
        growth.append(np.full(n, -np.inf))
        growth[-1][left] = np.log(sizes[sizes > 0])
    return np.array(growth).reshape(-1, n)


def orthogonal(columns: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make columns orthogonal one after the other; return unit vectors as rows, and the length that each column adds.

    That length is 0, and there is no vector, where it is below the error of the column.
    """
    found: list[np.ndarray] = []
    shares: list[float] = []  # errors of these unit vectors
    sizes = np.zeros(columns.shape[1])
    for k, (column, error) in enumerate(zip(columns.T, errors, strict=True)):
        rest, bound = column, max(error, ROUNDING * np.linalg.norm(column))
        for _ in range(2):  # twice, as rounding leaves something of a large part that is subtracted
            for unit, share in zip(found, shares, strict=True):
                along = unit @ rest
                rest, bound = rest - along * unit, bound + abs(along) * share
        size = np.linalg.norm(rest)
        if size > bound:
            sizes[k] = size
            found.append(rest / size)
            shares.append(float(bound / size))
    return np.array(found).reshape(-1, len(columns)), sizes


def _from_twin(
    section: Section, settled: bool, state: np.ndarray, here: np.ndarray, there: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the image of one direction after a forcing period, from a twin that starts along it; see `qr_growth`.

    The image lies in the coordinates that contact leaves free. In a motion that has not `settled` it is zero where only
    the spin of it is left: both ends have been at rest.
    """
    apart = section.rtol**0.5  # far above the errors of the map, far below the size of the motion
    free, left, point = free_coordinates(here), free_coordinates(there), section.point(state)
    twin = section.state(point + apart * directions[0], here)
    started = np.linalg.norm((section.point(twin) - point)[free])
    away, column = section.after(twin, 1)[0] - section.after(state.copy(), 1)[0], np.zeros((len(NAMES), 1))
    if settled or any(away[k] for k in left if NAMES[k] in FORGOTTEN):
        column[left, 0] = away[left] / started
    return column, np.zeros(1)
