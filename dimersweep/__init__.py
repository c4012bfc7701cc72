"""dimersweep: event-driven simulation of a 3D dimer on a vibrating plate, one run or millions of them."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dimersweep.errors import ParameterError, StoreError
    from dimersweep.parameters import Parameters
    from dimersweep.runs.run import Run, simulate
    from dimersweep.storage.netcdf import open_cube
    from dimersweep.studies.sweep import sweep

__version__ = "0.1.0"
__all__ = ["ParameterError", "Parameters", "Run", "StoreError", "open_cube", "simulate", "sweep"]

_HOME = {
    "ParameterError": "errors",
    "Parameters": "parameters",
    "Run": "run",
    "StoreError": "errors",
    "open_cube": "store",
    "simulate": "run",
    "sweep": "sweeping",
}


def __getattr__(name: str) -> Any:
    # importing Numba and xarray takes a second or two: pay it with the first name that needs them (PEP 562)
    if name not in _HOME:
        raise AttributeError(f"module 'dimersweep' has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(f"dimersweep.{_HOME[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
