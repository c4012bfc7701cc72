"""Orbits as labelled data."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.orbits.orbit import PeriodicOrbit
from dimersweep.runs.period_map import NAMES
from dimersweep.symbols import ORBIT_NAMES, QUANTITIES, Quantity

Column = tuple[Any, Quantity | str]  # entries, one an orbit or a row of numbers, and what they are

MOST_MULTIPLIERS = len(NAMES) - 1  # multipliers of a fast part at most; those that contact takes away are zero
COLUMNS = {
    "spin": QUANTITIES["spin"],
    **{name: QUANTITIES[name] for name in (*ORBIT_NAMES, "path_radius", "path_speed")},
    "spin_drift": Quantity("rad s-1", "change per forcing period: axial spin after the double impact"),
    "slow_multiplier": Quantity("1", "multiplier of the direction along the family"),
    "residual": Quantity("1", "how far the fast part fails to close, in units of the section"),
    "cost": Quantity("1", "forcing periods of the map spent up to here"),
}
WORDS = {
    "stable": Quantity("1", "whether all multipliers of the fast part are below 1 in size"),
    "periods": Quantity("1", "forcing periods after which the motion repeats"),
    "di_end": QUANTITIES["di_end"],
    "word": Quantity("1", "sequence of contact states"),
}
DOUBLING = Quantity("1", "coefficient of the flip: a stable orbit of twice the period begins where it is positive")
MULTIPLIERS = {
    "multipliers_real": Quantity("1", "real parts of the multipliers of the fast part, the largest first"),
    "multipliers_imag": Quantity("1", "imaginary parts of the multipliers of the fast part"),
}


def padded(values: np.ndarray) -> np.ndarray:
    """Multipliers, shape (MOST_MULTIPLIERS,), with zeros for the directions that contact takes away."""
    row = np.zeros(MOST_MULTIPLIERS, dtype=complex)
    row[: values.size] = values
    return row


def multiplier_columns(dims: Sequence[str], rows: np.ndarray) -> dict[str, xr.Variable]:
    """Multipliers as a table has them: NetCDF knows no complex numbers."""
    parts = zip(MULTIPLIERS.items(), (rows.real, rows.imag), strict=True)
    return {name: xr.Variable(dims, part, quantity.attributes()) for (name, quantity), part in parts}


def dataset(orbits: Sequence[PeriodicOrbit], dim: str, more: Mapping[str, Column] = {}) -> xr.Dataset:
    """The attributes of orbits along `dim`, and `more` columns; parameters that all share are attributes of the dataset."""
    columns = {name: ([getattr(orbit, name) for orbit in orbits], said) for name, said in (COLUMNS | WORDS).items()}
    table = xr.Dataset()
    for name, (entries, said) in (columns | dict(more)).items():
        values = np.array(entries, dtype=float if name in COLUMNS else None)
        if isinstance(said, str):
            attributes = {"long_name": said} if values.dtype.kind == "U" else {"units": "1", "long_name": said}
        else:
            attributes = said.attributes()
        table[name] = ((dim, "number")[: values.ndim], values, attributes)
    rows = np.array([padded(orbit.multipliers) for orbit in orbits]).reshape(-1, MOST_MULTIPLIERS)
    table = table.assign(multiplier_columns((dim, "multiplier"), rows))
    if orbits:
        first = orbits[0].parameters
        table.attrs = {k: v for k, v in first.items() if all(orbit.parameters.get(k) == v for orbit in orbits)}
    return table
