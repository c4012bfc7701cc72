"""Tables as NetCDF can hold them."""

import numpy as np
import xarray as xr


def storable(table: xr.Dataset) -> xr.Dataset:
    """A table without truth values, which NetCDF does not know."""
    table = table.copy()
    for name in list(table.data_vars):
        column = table[name]
        if column.dtype.kind == "b":
            flags = {"flag_values": np.array([0, 1], dtype=np.int8), "flag_meanings": "no yes"}
            table[name] = (
                column.dims,
                column.values.astype(np.int8),
                {"long_name": column.attrs.get("long_name", name)} | flags,
            )
        elif column.dtype.kind == "i":
            table[name] = column.astype(np.int32)
    for name in table.variables:
        if table[name].dtype.kind in "OU":
            table[name].attrs.pop("units", None)
    return table


def without_fill(table: xr.Dataset) -> xr.Dataset:
    """A table that is written without a fill value for its coordinates, which CF forbids."""
    for name in table.coords:
        table[name].encoding["_FillValue"] = None
    return table
