"""How sure verdicts are: whether they stand at other accuracies and from starts beside the given ones.

Two shadows of a point are the same run with more digits, and with fewer from a start beside it. Where one of them comes to
another mode, a change of verdict is that near. Where both come to the same mode but settle in another period, the transient
was another one, and the mode is luck. A motion that has not settled has no certain verdict: chaos may end after any time.
"""

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.kernel.batch import Workspace, run_many
from dimersweep.kernel.model.layout import (
    CODE_MODE,
    CODE_N_PERIODS,
    M_DRIFT,
    M_FLUTTER,
    M_JUMP,
    M_PERIOD_N,
    M_REST,
    N_ORBIT,
    OUT_SETTLED_AFTER,
    ROW_BETA0,
    ROW_PHI0,
    ROW_PHI_2,
    ROW_XDOT0,
)
from dimersweep.kernel.model.plate import phases_later
from dimersweep.parameters import RTOL_RANGE

CERTAIN, UNSURE, CHANGED = 1, 2, 3  # codes of ``cube.FLAGS["confidence"]``
FINER, COARSER = 1e-2, 1e2  # rtol of shadows, over that of the run
COARSE = 1e-6  # but the coarser one is at least this
ROUNDING = 1e-12  # nudge of the start with the finer rtol; with the coarser one it is that rtol
SETTLED = (M_REST, M_DRIFT, M_JUMP, M_FLUTTER, M_PERIOD_N)
ORBIT = tuple(range(N_ORBIT))


def certified(
    rows: np.ndarray,
    periods: int,
    rtol: float,
    settle: bool,
    out: np.ndarray,
    codes: np.ndarray,
    space: Workspace | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Confidence in the verdicts of points, and the error of their orbits.

    Parameters
    ----------
    rows : ndarray, shape (n, N_ROW), float64
        The points.
    periods, rtol, settle, space
        What they were run with, see ``kernel.batch.run_rows``.
    out, codes : ndarrays, shapes (n, N_OUT), (n, N_CODES)
        Their results.

    Returns
    -------
    confidence : ndarray, shape (n,), int64
        CERTAIN, UNSURE or CHANGED.
    error : ndarray, shape (n,), float64
        Largest relative difference of an orbit's quantities (of zeta and the impact phase: absolute) to those with more
        digits; NaN where the mode is not drift for both.
    """
    confidence = np.where(np.isin(codes[:, CODE_MODE], SETTLED), CERTAIN, UNSURE)
    error = np.full(len(rows), np.nan)
    finer = max(FINER * rtol, RTOL_RANGE[0])
    coarser = min(max(COARSER * rtol, COARSE), RTOL_RANGE[1])
    for shadow_rtol, nudge in ((finer, ROUNDING), (coarser, coarser)):
        left = np.flatnonzero(confidence == CERTAIN)
        shadow = run(nudged(rows[left], nudge), periods, shadow_rtol, settle, space)
        confidence[left] = compared((out[left], codes[left]), shadow)
        if shadow_rtol == finer:
            error[left] = orbit_difference(out[left], shadow[0])
    return confidence, error


def nudged(rows: np.ndarray, by: float) -> np.ndarray:
    """Points that start with `beta0` less and `xdot0` more by the share `by`, and the plate later by `by` radians."""
    moved = rows.copy()
    moved[:, ROW_BETA0] *= 1 - by
    moved[:, ROW_XDOT0] *= 1 + by
    moved[:, ROW_PHI0], moved[:, ROW_PHI_2] = phases_later(moved[:, ROW_PHI0], moved[:, ROW_PHI_2], by)
    return moved


def run(
    rows: np.ndarray, periods: int, rtol: float, settle: bool, space: Workspace | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Results of points: `out` and `codes` as the kernel gives them."""
    out, codes = blank(len(rows))
    run_many(rows, periods, rtol, settle, out, codes, space=space)
    return out, codes


def compared(results: tuple[np.ndarray, np.ndarray], shadow: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """CERTAIN, UNSURE or CHANGED, for points with these results, given those of their shadows; shape (n,)."""
    (out, codes), (other_out, other_codes) = results, shadow
    ended = codes[:, CODE_N_PERIODS] == other_codes[:, CODE_N_PERIODS]
    after, other_after = out[:, OUT_SETTLED_AFTER], other_out[:, OUT_SETTLED_AFTER]
    alike = ended & ((after == other_after) | np.isnan(after))  # what rests has no period that it settled in
    return np.where(codes[:, CODE_MODE] != other_codes[:, CODE_MODE], CHANGED, np.where(alike, CERTAIN, UNSURE))


def orbit_difference(out: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Largest difference of the orbits of two sets of results, shape (n,); NaN where one has none."""
    ours, theirs = out[:, ORBIT], other[:, ORBIT]
    apart = np.abs(ours - theirs)
    apart[:, 5] = np.minimum(apart[:, 5], 1 - apart[:, 5])  # of a phase: round the cycle
    scale = np.abs(ours)
    scale[:, [2, 5]] = 1.0
    return np.asarray(np.max(apart / scale, axis=1))
