"""Options that decide how a study is run, but none of its numbers: workers, output, points of other cubes."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypedDict, Unpack

from dask.system import CPU_COUNT

from dimersweep.inputs import check_count, check_seconds
from dimersweep.storage.provenance import check_attrs
from dimersweep.symbols import PARAMETERS
from dimersweep.work.parts import SweepPart

MAX_WORKERS = 4096  # most threads that may be asked for: a larger number is a typing error


class MakingKeywords(TypedDict, total=False):
    """Options of a study as keyword arguments, besides its output; see `sweep`."""

    workers: int | None
    progress: bool
    force: bool
    attrs: Mapping[str, Any] | None
    client: Any
    extend: str | os.PathLike[str] | None
    retry: bool
    fail_fast: bool
    keep_tiles: bool
    part: str | tuple[int, int] | None
    give_up_after: float | str | None


class OptionKeywords(MakingKeywords, total=False):
    """Options of a study as keyword arguments; see `sweep`."""

    out: str | os.PathLike[str] | None


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a study besides its settings, checked; `make_options` makes them from what a user gives."""

    workers: int  # threads of this process, where there is no client
    client: Any = None
    progress: bool = True
    fail_fast: bool = False
    out: Path | None = None
    force: bool = False
    keep_tiles: bool = False
    attrs: Mapping[str, Any] = field(default_factory=dict)
    extend: str | os.PathLike[str] | None = None
    retry: bool = False
    part: SweepPart | None = None
    give_up_after: float | None = None  # [s]


IN_PASSING = Options(workers=1, progress=False)  # options of a small study within another calculation


def make_options(**given: Unpack[OptionKeywords]) -> Options:
    """Check the options that a user gives, see `sweep`; without `workers`, take as many threads as there are cores.

    Raises
    ------
    ParameterError
        If `workers`, `part` or one of `attrs` is not allowed.
    TypeError
        For an unknown option.
    """
    for name, value in given.items():
        if name not in OptionKeywords.__optional_keys__:
            fixed = f"; what is the same at all points goes into fixed = {{{name!r}: {value!r}}}"
            if hasattr(value, "__len__") and not isinstance(value, str):
                fixed = f"; give the axes as a mapping: {{{name!r}: {value!r}}}"
            raise TypeError(f"{name} = {value!r}: unknown option{fixed if name in PARAMETERS else ''}")
    out, workers, part = given.get("out"), given.get("workers"), given.get("part")
    checked: dict[str, Any] = dict(given) | {
        "workers": CPU_COUNT if workers is None else check_count("workers", workers, MAX_WORKERS),
        "out": None if out is None else Path(out),
        "attrs": check_attrs(given.get("attrs")),
        "give_up_after": check_seconds(given.get("give_up_after"), "give_up_after"),
        "part": None if part is None else SweepPart.of(part),
    }
    return Options(**checked)
