"""The interface of a format of cubes, and changes of datasets that all formats share."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import kind_of_whole


def range_of(values: np.ndarray) -> np.ndarray:
    """Return the least and the greatest of the finite values, shape (2,), which is `actual_range` in CF.

    The shape is (0,) if no value is finite.
    """
    known = values[np.isfinite(values)]
    ends = [known.min(), known.max()] if known.size else []
    return np.array(ends, dtype=np.int8 if values.dtype == bool else values.dtype)


def for_others(dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset in the form that is written, which programs for classic NetCDF files can read.

    Variables of numbers get their `actual_range`. Texts and lists of texts in attributes become bytes in UTF-8. Whole
    numbers in attributes have 32 bits if these hold them. Variables along an empty dimension are left out, as the
    dimension would be unlimited.
    """
    made = dataset.drop_vars([name for name, each in dataset.variables.items() if 0 in each.shape]).copy()
    made.attrs = {name: _attribute(value) for name, value in dataset.attrs.items()}
    for each in made.variables.values():
        each.attrs = {name: _attribute(value) for name, value in each.attrs.items()}
        if each.dtype.kind in "OU":
            each.encoding["dtype"] = "S1"  # see `column`
        elif each.dtype.kind in "biuf" and (ends := range_of(each.values)).size:
            each.attrs["actual_range"] = ends
        each.encoding.pop("char_dim_name", None)  # a former file may have had longer texts
    return made


def _attribute(value: Any) -> Any:
    """Return the value of an attribute in the form that is written."""
    values = np.asarray(value)
    if values.dtype.kind in "OU":
        text = "; ".join(map(str, values.ravel().tolist()))
        return text if text.isascii() else text.encode()
    whole = values.dtype.kind in "iu" and values.dtype.itemsize > 1  # codes of flags stay bytes
    return values.astype(kind_of_whole(values))[()] if whole else value


def as_made(dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset that was read without the `actual_range` of `for_others`; decode texts of older files."""
    for each in dataset.variables.values():
        each.attrs.pop("actual_range", None)
    texts = {name: each for name, each in dataset.variables.items() if each.dtype.kind == "S"}
    return dataset.assign({name: each.copy(data=np.char.decode(each.values, "utf-8")) for name, each in texts.items()})


class Format(NamedTuple):
    """A format of cubes: its ending, its names, and functions to read and write it.

    Attributes
    ----------
    ending : str
        Ending of paths, such as ``.nc``.
    name, noun : str
        Name of the format, and of a file or folder in this format, for messages.
    opened : callable
        ``with opened(path) as dataset`` opens the dataset at `path`. Values may be read when they are used. Raises a
        StoreError if the file is damaged, or has another format.
    write : callable, optional
        ``write(dataset, path, scratch)`` writes a dataset in memory to `path` in one step, by the temporary path
        `scratch`, or one of its own. Raises an OSError or RuntimeError if the disk refuses.
    write_blocks : callable, optional
        Function in place of `write` for cubes larger than memory, see `write_zarr`. Their values are read when they are
        used.
    check : callable, optional
        Raises a StoreError if a package is missing.
    marker : str
        Name of a file that all folders of the format have; "" for a format of single files.
    """

    ending: str
    name: str
    noun: str
    opened: Callable[[Path], AbstractContextManager[xr.Dataset]]
    write: Callable[[xr.Dataset, Path, Path | None], None] | None = None
    write_blocks: Callable[..., None] | None = None
    check: Callable[[], None] = lambda: None
    marker: str = ""
