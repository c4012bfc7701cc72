"""The options that sweep, search and refine share: where the cube goes, who runs the points, what is taken from other cubes."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from dimersweep.cubes.results import not_ok, not_run
from dimersweep.storage.provenance import check_attrs
from dimersweep.symbols import PARAMETERS
from dimersweep.work.computing import How, make_how


class Manner(TypedDict, total=False):
    """The options but for the output, as keyword arguments that may be left out; see `sweep`."""

    workers: int | None
    progress: bool
    force: bool
    attrs: Mapping[str, Any] | None
    client: Any
    extend: str | os.PathLike[str] | None
    retry: bool
    fail_fast: bool
    keep_tiles: bool


class Given(Manner, total=False):
    """All options as keyword arguments that may be left out; see `sweep`."""

    out: str | os.PathLike[str] | None


@dataclass(frozen=True)
class Options:
    """How a cube is made, but none of its numbers; get one from `make_options`.

    Parameters
    ----------
    how : How
        Who runs the points.
    out : Path, optional
        The file of the cube.
    force, keep_tiles : bool
        Whether `out` may replace what is there, and whether the folder of finished points stays.
    attrs : mapping
        Further global attributes.
    extend : path-like, optional
        A cube whose points are taken over.
    retry : bool
        Whether points that failed there, or at `out`, are run again.
    """

    how: How
    out: Path | None = None
    force: bool = False
    keep_tiles: bool = False
    attrs: Mapping[str, Any] = field(default_factory=dict)
    extend: str | os.PathLike[str] | None = None
    retry: bool = False

    def unwanted(self, codes: np.ndarray) -> np.ndarray:
        """Which points of another cube, from codes of shape (n, N_CODES), are not taken over; shape (n,), bool."""
        return not_ok(codes) if self.retry else not_run(codes)


def make_options(**given: Unpack[Given]) -> Options:
    """Options from what a user gives, see `sweep`.

    Raises
    ------
    ParameterError
        If `workers` or one of `attrs` is not allowed.
    TypeError
        For an option that there is not.
    """
    for name, value in given.items():
        if name not in Given.__optional_keys__:
            fixed = f"; what is the same at all points goes into fixed = {{{name!r}: {value!r}}}"
            raise TypeError(f"{name} = {value!r}: unknown option{fixed if name in PARAMETERS else ''}")
    out, progress, fail_fast = given.get("out"), given.get("progress", True), given.get("fail_fast", False)
    return Options(
        make_how(given.get("workers"), given.get("client"), progress=progress, fail_fast=fail_fast),
        None if out is None else Path(out),
        given.get("force", False),
        given.get("keep_tiles", False),
        check_attrs(given.get("attrs")),
        given.get("extend"),
        given.get("retry", False),
    )
