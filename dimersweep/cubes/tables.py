"""Columns of tables and what holds for all of a table, labelled as those of cubes are."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import flag_attributes, labelled
from dimersweep.symbols import PARAMETERS, Quantity

NO_YES = ("no", "yes")  # words of truth values


def column(dims: str | Sequence[str], entries: Any, said: Quantity | str, words: Sequence[str] = ()) -> xr.Variable:
    """A column of a table: numbers with their unit, texts, or flags, which are one of a few `words`.

    Entries of flags are their words or codes. Truth values are flags, too, and stay such: xarray writes and reads them.
    """
    values, quantity = np.asarray(entries), said if isinstance(said, Quantity) else Quantity("1", said)
    kind = values.dtype.kind
    if words and kind in "OU":
        values = np.vectorize(words.index, otypes=[np.int8])(values)
    if words or kind == "b":
        attributes = flag_attributes(quantity.long_name, words or NO_YES)
        return xr.Variable(dims, values.astype(np.int8) if words else values, attributes)
    texts = {"long_name": quantity.long_name}
    return xr.Variable(dims, values, texts if kind in "OSU" else quantity.attributes(values.dtype.type))


def fixed_coordinates(parameters: Mapping[str, float]) -> dict[str, xr.Variable]:
    """Parameters that hold for all of a table, with their units."""
    return {name: labelled(xr.Variable((), value), PARAMETERS[name]) for name, value in parameters.items()}


def without_fill(table: xr.Dataset) -> xr.Dataset:
    """A table that is written without a fill value for its coordinates, which CF forbids."""
    for name in table.coords:
        table[name].encoding["_FillValue"] = None
    return table
