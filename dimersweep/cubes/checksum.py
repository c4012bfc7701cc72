"""A checksum over the coordinates and the values of a cube together: one that was cut, turned or moved has another one."""

import json
from hashlib import sha256
from typing import Any

import numpy as np
import xarray as xr


class Checksum:
    """The checksum of a cube whose values come in pieces.

    Parameters
    ----------
    cube : xarray.Dataset
        Its variables give names, dimensions and types; no value of it is read.
    """

    def __init__(self, cube: xr.Dataset) -> None:
        heads = {
            name: (each.dims, each.shape, each.dtype.kind, each.dtype.itemsize) for name, each in cube.variables.items()
        }
        self._sums = {str(name): sha256(repr(head).encode()) for name, head in heads.items()}

    def add(self, name: Any, values: np.ndarray) -> None:
        """Take the next values of a variable, in C order."""
        if values.dtype.kind == "f":
            values = np.where(np.isnan(values), np.nan, values)  # its bits mean nothing, and may change in a file
        self._sums[str(name)].update(values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes())

    def digest(self) -> str:
        """The sha256 of what was taken, whatever the order of the variables."""
        sums = {name: each.hexdigest() for name, each in self._sums.items()}
        return sha256(json.dumps(sums, sort_keys=True).encode()).hexdigest()
