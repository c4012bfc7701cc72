"""Parts of a sweep, each for a process of its own that knows nothing of the others: its points, and its file."""

import re
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple, Self

from dimersweep.cubes.results import Tile
from dimersweep.errors import ParameterError

TILES = 64  # largest number of tiles of a part: enough to spread each part over the grid, while its store has few rows
PARTS_AT_MOST = 10_000  # largest number of parts


class SweepPart(NamedTuple):
    """The part `number` of `total` parts, counted from 1."""

    number: int
    total: int

    @classmethod
    def of(cls, given: Any) -> Self:
        """Return the part that ``"3/20"``, or ``(3, 20)``, asks for; raise a ParameterError for anything else."""
        text = "/".join(map(str, given)) if isinstance(given, tuple | list) else str(given)
        found = re.fullmatch(r"\s*([0-9]{1,5})\s*/\s*([0-9]{1,5})\s*", text)
        part = cls(*map(int, found.groups())) if found else cls(0, 0)
        if not 1 <= part.number <= part.total <= PARTS_AT_MOST:
            raise ParameterError(f"part = {given!r}: must be k/n with 1 <= k <= n <= {PARTS_AT_MOST}, such as 3/20")
        return part

    def __str__(self) -> str:
        return f"{self.number}/{self.total}"

    def file(self, out: Path) -> Path:
        """Return the file of this part of the cube `out`."""
        return out.with_name(f"{out.stem}.part-{self.number}-of-{self.total}{out.suffix}")

    def ranges(self, size: int, line: int = 1) -> list[Tile]:
        """Return the tiles of this part in a grid of `size` points, in order, each of whole lines of `line` points.

        The tiles of the grid are dealt to the parts in rounds, and the order of the parts moves on by one from round to
        round. Otherwise, if the tiles of a row of the grid were a multiple of the parts, each part would have only some
        columns, which may be quick or slow.
        """
        length = line * ceil(size / line / (TILES * self.total))
        rounds = range(ceil(size / (length * self.total)))
        starts = (length * (each * self.total + (self.number - 1 + each) % self.total) for each in rounds)
        return [Tile(start, min(start + length, size)) for start in starts if start < size]
