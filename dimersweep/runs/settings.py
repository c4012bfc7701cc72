"""How runs are made: their length and accuracy, and points that are given more time until they settle."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count, check_rtol, check_switch
from dimersweep.kernel.batch import Workspace, run_many
from dimersweep.kernel.model.layout import CODE_MODE, M_APERIODIC, M_FAILED, M_UNRESOLVED

SLOW_MODES = sum(1 << mode for mode in (M_FAILED, M_APERIODIC, M_UNRESOLVED))  # these use all periods they are given


class RunSettings(NamedTuple):
    """How long and how accurate the runs of points are; see `run_patiently`."""

    periods: int  # forcing periods of the first run of a point
    max_periods: int  # and of the longest
    rtol: float  # accuracy [1]
    stop_when_settled: bool = True  # whether a run ends as soon as its motion has settled and its numbers stand

    def lengths(self) -> Iterator[int]:
        """Forcing periods of the runs of a point that does not settle, one after the other: each twice those before."""
        periods = self.periods
        yield periods
        while periods < self.max_periods:
            periods = min(2 * periods, self.max_periods)
            yield periods


def exactly(periods: int, rtol: float) -> RunSettings:
    """Settings of runs of so many forcing periods, whether or not their motions settle."""
    return RunSettings(periods, periods, rtol, stop_when_settled=False)


def run_settings(
    *, periods: int, max_periods: int | None = None, rtol: float = 1e-8, stop_when_settled: bool = True
) -> RunSettings:
    """Settings of runs from what a user gives, see `sweep`.

    Raises
    ------
    ParameterError
        Naming what is not allowed.
    """
    periods = check_count("periods", periods)
    longest = periods if max_periods is None else check_count("max_periods", max_periods)
    if longest < periods:
        raise ParameterError(f"max_periods = {longest}: must be >= periods = {periods}")
    settles = check_switch("stop_when_settled", stop_when_settled)
    if longest > periods and not settles:
        raise ParameterError(f"max_periods = {longest}: is for runs that stop when they have settled")
    return RunSettings(periods, longest, check_rtol(rtol), settles)


def run_patiently(
    rows: np.ndarray,
    how: RunSettings,
    out: np.ndarray,
    codes: np.ndarray,
    until: int = 0,
    space: Workspace | None = None,
) -> int:
    """Run points as `run_many` does, up to the first that has not settled; that one again for twice as long, and so on.

    A longer run starts anew: what comes out depends on the point alone. Most motions settle soon, and those that ring down
    slowly are too few to be given all they may need at once.

    Parameters
    ----------
    rows, out, codes, until, space
        See ``kernel.batch.run_rows``.
    how : RunSettings

    Returns
    -------
    int
        Number of points made.
    """
    rtol, settle = how.rtol, how.stop_when_settled
    first, *longer = how.lengths()
    made = run_many(rows, first, rtol, settle, out, codes, until=until | 1 << M_UNRESOLVED, space=space)
    last = slice(made - 1, made)
    for more in longer:
        if not made or codes[made - 1, CODE_MODE] != M_UNRESOLVED:
            break
        if not run_many(rows[last], more, rtol, settle, out[last], codes[last], until=until, space=space):
            return made - 1  # it was stopped
    return made


def run_all_patiently(
    rows: np.ndarray, how: RunSettings, space: Workspace | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Results of all points by `run_patiently`: `out` and `codes`, blank from where the work was stopped."""
    out, codes = blank(len(rows))
    done, made = 0, 1
    while made and done < len(rows):
        made = run_patiently(rows[done:], how, out[done:], codes[done:], space=space)
        done += made
    return out, codes
