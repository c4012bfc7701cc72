"""Formats of cubes. A format that stands in `FORMATS` is known to sweeps, declarations, pictures and pages."""

import os
from pathlib import Path

from dimersweep.storage.formats.format import Format
from dimersweep.storage.formats.netcdf import NETCDF
from dimersweep.storage.formats.zarr import ZARR

FORMATS: dict[str, Format] = {each.ending: each for each in (NETCDF, ZARR)}


def format_of(path: Path) -> Format:
    """Return the format that the ending of a path names; NetCDF if it names none."""
    return FORMATS.get(path.suffix, NETCDF)


def format_at(path: Path) -> Format:
    """Return the format of the file or folder at `path`; a file with an ending of folders counts as NetCDF."""
    named = format_of(path)
    return NETCDF if named.marker and not os.path.isdir(path) else named
