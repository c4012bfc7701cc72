"""dimersweep: event-driven simulation of a 3D dimer on a vibrating plate, one run or millions of them.

Examples
--------
>>> import dimersweep
>>> run = dimersweep.simulate(Gamma=0.9, f=15, periods=100)
>>> run.mode, round(run.orbit.radius, 2)
('drift', 4.24)
>>> angles = {"start": 10, "stop": 30, "step": 10, "unit": "deg"}
>>> cube = dimersweep.sweep({"beta0": angles}, periods=100, progress=False)
>>> dimersweep.names(cube["mode"]).values.tolist()
['rest', 'drift', 'drift']
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dimersweep.faces import __version__ as __version__

if TYPE_CHECKING:
    from dimersweep import fits, orbits
    from dimersweep.cubes.cube import names
    from dimersweep.errors import ParameterError, StoreError
    from dimersweep.exploring.serving import explore
    from dimersweep.fits.fitting import fit
    from dimersweep.parameters import Parameters
    from dimersweep.runs import stability
    from dimersweep.runs.run import Run, load_run
    from dimersweep.runs.simulating import simulate
    from dimersweep.storage.cubefiles import open_cube
    from dimersweep.studies.attractors import attractors
    from dimersweep.studies.loops import loops
    from dimersweep.studies.refine import refine
    from dimersweep.studies.search import search
    from dimersweep.studies.sweep import bifurcation, sweep

__all__ = [
    "ParameterError",
    "Parameters",
    "Run",
    "StoreError",
    "attractors",
    "bifurcation",
    "explore",
    "fit",
    "fits",
    "load_run",
    "loops",
    "names",
    "open_cube",
    "orbits",
    "refine",
    "search",
    "simulate",
    "stability",
    "sweep",
]

_ROOMS = ("cubes", "errors", "fits", "orbits", "plots", "runs", "studies")  # with the names that are not here
_MODULES = {room: room for room in _ROOMS} | {"stability": "runs.stability"}
_HOME = {
    "ParameterError": "errors",
    "Parameters": "parameters",
    "Run": "runs.run",
    "StoreError": "errors",
    "attractors": "studies.attractors",
    "bifurcation": "studies.sweep",
    "explore": "exploring.serving",
    "fit": "fits.fitting",
    "load_run": "runs.run",
    "loops": "studies.loops",
    "names": "cubes.cube",
    "open_cube": "storage.cubefiles",
    "refine": "studies.refine",
    "search": "studies.search",
    "simulate": "runs.simulating",
    "sweep": "studies.sweep",
}
_MAKES_CUBES = ("bifurcation", "open_cube", "refine", "search", "sweep")


def __getattr__(name: str) -> Any:
    # importing Numba and xarray takes a second or two: pay it with the first name that needs them (PEP 562)
    if name in _MODULES:
        value = import_module(f"dimersweep.{_MODULES[name]}")
    elif name in _HOME:
        value = getattr(import_module(f"dimersweep.{_HOME[name]}"), name)
    else:
        raise AttributeError(f"module 'dimersweep' has no attribute {name!r}")
    if name in _MAKES_CUBES:
        import_module("dimersweep.runs.accessor")  # which gives every cube its `cube.dimersweep`
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS})
