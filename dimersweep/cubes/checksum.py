"""A checksum over the coordinates and the values of a cube together: one that was cut, turned or moved has another one."""

import json
from hashlib import sha256
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.results import MESSAGE_BYTES


def _type_of(variable: xr.Variable) -> np.dtype:
    """The type that values are summed in, whatever one a copy keeps them in: classic files have no whole numbers of 64 bits."""
    whole = "<i1" if "flag_values" in variable.attrs else "<i8"
    known = {"f": "<f8", "i": whole, "u": whole} | dict.fromkeys("OSU", f"S{MESSAGE_BYTES}")
    return np.dtype(known.get(variable.dtype.kind, variable.dtype))


class Checksum:
    """The checksum of a cube whose values come in pieces.

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
        """Take the next values of a variable, in C order."""
        if values.dtype.kind == "f":
            values = np.where(np.isnan(values), np.nan, values)  # its bits mean nothing, and may change in a file
        elif values.dtype.kind in "OU":
            values = np.char.encode(values.astype(str), "utf-8")
        self._sums[str(name)].update(values.astype(self._types[str(name)], copy=False).tobytes())

    def digest(self) -> str:
        """The sha256 of what was taken, whatever the order of the variables."""
        sums = {name: each.hexdigest() for name, each in self._sums.items()}
        return sha256(json.dumps(sums, sort_keys=True).encode()).hexdigest()
