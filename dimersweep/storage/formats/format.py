"""What a format of cubes is."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import kind_of_whole


def range_of(values: np.ndarray) -> np.ndarray:
    """The least and the greatest of numbers that are finite, shape (2,), CF's `actual_range`; shape (0,) if there is none."""
    known = values[np.isfinite(values)]
    ends = [known.min(), known.max()] if known.size else []
    return np.array(ends, dtype=np.int8 if values.dtype == bool else values.dtype)


def for_others(dataset: xr.Dataset) -> xr.Dataset:
    """A dataset as it is written, so that programs read it that know classic files alone.

    Numbers tell the range that they have. Texts and lists of texts in attributes are bytes in UTF-8, and their whole numbers
    have 32 bits where these hold them. What lies along a dimension without a place is left out: its dimension would grow.
    """
    made = dataset.drop_vars([name for name, each in dataset.variables.items() if 0 in each.shape]).copy()
    made.attrs = {name: _attribute(value) for name, value in dataset.attrs.items()}
    for each in made.variables.values():
        each.attrs = {name: _attribute(value) for name, value in each.attrs.items()}
        if each.dtype.kind in "OU":
            each.encoding["dtype"] = "S1"  # see `column`
        elif each.dtype.kind in "biuf" and (ends := range_of(each.values)).size:
            each.attrs["actual_range"] = ends
        each.encoding.pop("char_dim_name", None)  # of texts that were perhaps longer
    return made


def _attribute(value: Any) -> Any:
    values = np.asarray(value)
    if values.dtype.kind in "OU":
        text = "; ".join(map(str, values.ravel().tolist()))
        return text if text.isascii() else text.encode()
    whole = values.dtype.kind in "iu" and values.dtype.itemsize > 1  # not codes of flags
    return values.astype(kind_of_whole(values))[()] if whole else value


def as_made(dataset: xr.Dataset) -> xr.Dataset:
    """A dataset that was read, without what `for_others` tells besides; texts of former files are bytes."""
    for each in dataset.variables.values():
        each.attrs.pop("actual_range", None)
    texts = {name: each for name, each in dataset.variables.items() if each.dtype.kind == "S"}
    return dataset.assign({name: each.copy(data=np.char.decode(each.values, "utf-8")) for name, each in texts.items()})


class Format(NamedTuple):
    """A format of cubes: how they are named, read and written.

    Attributes
    ----------
    ending : str
        Of their paths, such as ``.nc``.
    name, noun : str
        Of the format, and of one that is written in it.
    opened : callable
        ``with opened(path) as dataset``: what is at `path`, which may read its values when they are used. Raises a
        StoreError where that is damaged, or not of this format.
    write : callable, optional
        ``write(dataset, path, scratch)`` puts a dataset that is in memory at `path` in one step, by a temporary name that
        is `scratch` or its own. An OSError or RuntimeError says that the disk refuses.
    write_blocks : callable, optional
        See `write_zarr`: in place of `write`, where cubes may be larger than memory. Their values are read when they are used.
    check : callable, optional
        Raises a StoreError if a package is missing.
    marker : str
        Name of a file that all of its folders hold; empty for a format of single files.
    """

    ending: str
    name: str
    noun: str
    opened: Callable[[Path], AbstractContextManager[xr.Dataset]]
    write: Callable[[xr.Dataset, Path, Path | None], None] | None = None
    write_blocks: Callable[..., None] | None = None
    check: Callable[[], None] = lambda: None
    marker: str = ""
