"""Compute one checksum over the coordinates and values of a cube; a cube that was cut, turned or moved has another."""

import json
from hashlib import sha256
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.results import MESSAGE_BYTES


def _type_of(variable: xr.Variable) -> np.dtype:
    """Return the type in which values are summed, whatever type a copy keeps them in.

    A classic file has no integers of 64 bits and no strings, so its copy of a cube has other types.
    """
    whole = "<i1" if "flag_values" in variable.attrs else "<i8"
    known = {"f": "<f8", "i": whole, "u": whole} | dict.fromkeys("OSU", f"S{MESSAGE_BYTES}")
    return np.dtype(known.get(variable.dtype.kind, variable.dtype))


class Checksum:
    """Checksum of a cube whose values come in pieces.

    Parameters
    ----------
    cube : xarray.Dataset
        Its variables give names, dimensions and types; no value of it is read.
    """

    def __init__(self, cube: xr.Dataset) -> None:
        self._types = {str(name): _type_of(each) for name, each in cube.variables.items()}
        self._sums = {}
        for name, kind in self._types.items():
            head = (cube.variables[name].dims, cube.variables[name].shape, kind.kind, kind.itemsize)
            self._sums[name] = sha256(repr(head).encode())

    def add(self, name: Any, values: np.ndarray) -> None:
        """Add the next values of the variable `name` to the checksum, in C order."""
        if values.dtype.kind == "f":
            # the bits of a NaN mean nothing and may change in a file: give all NaN the same bits
            values = np.where(np.isnan(values), np.nan, values)
        elif values.dtype.kind in "OU":
            values = np.char.encode(values.astype(str), "utf-8")
        self._sums[str(name)].update(values.astype(self._types[str(name)], copy=False).tobytes())

    def digest(self) -> str:
        """Return the sha256 of all values that were added; the order of the variables does not matter."""
        sums = {name: each.hexdigest() for name, each in self._sums.items()}
        return sha256(json.dumps(sums, sort_keys=True).encode()).hexdigest()
