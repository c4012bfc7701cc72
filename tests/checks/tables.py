"""What tests read of tables."""

import numpy as np
import xarray as xr


def multipliers(table: xr.Dataset) -> np.ndarray:
    """The multipliers of a table of orbits."""
    return table["multipliers_real"].values + 1j * table["multipliers_imag"].values
