"""What a format of cubes is."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

import xarray as xr


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
