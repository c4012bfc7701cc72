"""Formats of cubes. One in `FORMATS` is known to sweeps, declarations, pictures and pages."""

import os
from pathlib import Path

from dimersweep.storage.formats.format import Format
from dimersweep.storage.formats.netcdf import NETCDF
from dimersweep.storage.formats.zarr import ZARR

FORMATS: dict[str, Format] = {each.ending: each for each in (NETCDF, ZARR)}


def format_of(path: Path) -> Format:
    """The format that the ending of a path names: NetCDF where it names none."""
    return FORMATS.get(path.suffix, NETCDF)


def format_at(path: Path) -> Format:
    """The format of what is at `path`: a file is NetCDF if its ending names folders."""
    named = format_of(path)
    return NETCDF if named.marker and not os.path.isdir(path) else named
