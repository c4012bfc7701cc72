"""Runs from drawn starts, each with the state that it has come to: the work behind `attractors`."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dimersweep.cubes.points import Points, make_points
from dimersweep.cubes.results import RESULT, Bundle, Tile
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count, number
from dimersweep.kernel.batch import N_START, Workspace
from dimersweep.kernel.model.layout import CODE_STATUS, STOPPED
from dimersweep.parameters import check_name
from dimersweep.runs.settings import RunSettings, run_row_patiently
from dimersweep.storage.memorystore import MemoryStore
from dimersweep.symbols import START
from dimersweep.work.computing import crew
from dimersweep.work.options import Options
from dimersweep.work.tiles import around

STARTING = (*START, "phi0")  # parameters that starts are drawn from
ENDED = np.dtype([*RESULT.descr, ("end", "<f8", (N_START,))])  # a result, and the state and friction modes at the end


@dataclass(frozen=True)
class Drawn:
    """Runs from single points up to their verdict, whose ends are kept.

    Parameters
    ----------
    grid : Points
    how : RunSettings
    """

    grid: Points
    how: RunSettings

    kind, line = ENDED, 1

    def advance(self, points: np.ndarray, results: np.ndarray, space: Workspace) -> int:
        """See `Work`."""
        for k, row in enumerate(self.grid.rows_at(points)):
            solved = run_row_patiently(row, None, self.how, space)
            if solved.codes[CODE_STATUS] == STOPPED:
                return k
            results[k] = (solved.out, solved.codes, solved.end.start[0])
        return len(points)

    def narrowed(self, tiles: Bundle) -> tuple["Drawn", Bundle, int]:
        """See `Work`."""
        grid, moved, shift = around(self.grid, tiles)
        return replace(self, grid=grid), moved, shift

    def run(self, options: Options) -> np.ndarray:
        """Results of all points, shape (n,), of `ENDED`.

        Raises
        ------
        UnfinishedError, Stopped
            As by `sweep`.
        """
        store = MemoryStore(self.grid.size, self.kind)
        with crew(store, options) as team:
            team.expect(self.grid.size)
            team.run(self, [Tile(0, self.grid.size)])
        return store.results


def drawn_starts(ranges: Any, fixed: Any, points: Any, starts: int, seed: int) -> dict[str, np.ndarray]:
    """Columns of starts: those of a table, or drawn evenly and independently from ranges, whose ends are judged as starts.

    Raises
    ------
    ParameterError
        Naming what is not allowed.
    """
    if (ranges is None) == (points is None):
        raise ParameterError("ranges: give either ranges to draw from or points")
    if points is not None:
        columns = make_points(points).columns
        _check_starts(columns)
        return columns
    if not isinstance(ranges, Mapping) or not ranges:
        raise ParameterError(f"ranges = {ranges!r}: must be a mapping of parameters to pairs such as (0.1, 0.5)")
    _check_starts(ranges)
    count = check_count("starts", starts)
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ParameterError(f"seed = {seed!r}: must be a whole number >= 0")
    pairs, draw = {name: _pair(name, pair) for name, pair in ranges.items()}, np.random.default_rng(int(seed))
    make_points(pairs, fixed)
    return {name: draw.uniform(low, high, size=count) for name, (low, high) in pairs.items()}


def _check_starts(names: Iterable[str]) -> None:
    """Refuse to draw what makes another dimer or another plate: motions are compared on one."""
    for name in names:
        check_name(name)
        if name not in STARTING:
            raise ParameterError(f"{name}: is no part of a start; draw from {', '.join(STARTING)}")


def _pair(name: str, pair: Any) -> tuple[float, float]:
    """The ends of a range in SI units."""
    if not isinstance(pair, list | tuple | np.ndarray) or len(pair) != 2:
        raise ParameterError(f"{name} = {pair!r}: must be a pair of its least and its greatest value")
    low, high = (number(name, value) for value in pair)
    if not low < high:
        raise ParameterError(f"{name} = {low:g} to {high:g}: the least value must be below the greatest")
    return low, high
