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
    from dimersweep.cubes.findings import (
        Minimum,
        PowerLaw,
        boundary,
        circle_through,
        drift_intervals,
        drift_lengths,
        exponents,
        minimum,
        runs_of,
        stick_ratio,
    )
    from dimersweep.errors import ParameterError, PointError, Stopped, StoreError
    from dimersweep.exploring.serving import explore
    from dimersweep.fits.fitting import fit
    from dimersweep.parameters import Parameters
    from dimersweep.runs import growth as stability
    from dimersweep.runs.growth import Lyapunov, Multipliers, Spectrum, lyapunov, multipliers, qr_growth, spectrum
    from dimersweep.runs.outcomes import Orbit
    from dimersweep.runs.run import Run, load_run
    from dimersweep.runs.simulating import simulate
    from dimersweep.storage.cubefiles import open_cube
    from dimersweep.studies.attractors import attractors
    from dimersweep.studies.declared import make, read_declaration
    from dimersweep.studies.loops import loops
    from dimersweep.studies.refine import refine
    from dimersweep.studies.search import search
    from dimersweep.studies.sweep import bifurcation, sweep

__all__ = [
    "Lyapunov",
    "Minimum",
    "Multipliers",
    "Orbit",
    "ParameterError",
    "Parameters",
    "PointError",
    "PowerLaw",
    "Run",
    "Spectrum",
    "Stopped",
    "StoreError",
    "attractors",
    "bifurcation",
    "boundary",
    "circle_through",
    "drift_intervals",
    "drift_lengths",
    "explore",
    "exponents",
    "fit",
    "fits",
    "load_run",
    "loops",
    "lyapunov",
    "make",
    "minimum",
    "multipliers",
    "names",
    "open_cube",
    "orbits",
    "qr_growth",
    "read_declaration",
    "refine",
    "runs_of",
    "search",
    "simulate",
    "spectrum",
    "stability",
    "stick_ratio",
    "sweep",
]

_ROOMS = ("cubes", "errors", "fits", "orbits", "plots", "runs", "studies")  # with the names that are not here
_MODULES = {room: room for room in _ROOMS} | {"stability": "runs.growth"}
_NAMES = {
    "cubes.cube": ("names",),
    "cubes.findings": (
        "Minimum",
        "PowerLaw",
        "boundary",
        "circle_through",
        "drift_intervals",
        "drift_lengths",
        "exponents",
        "minimum",
        "runs_of",
        "stick_ratio",
    ),
    "errors": ("ParameterError", "PointError", "Stopped", "StoreError"),
    "exploring.serving": ("explore",),
    "fits.fitting": ("fit",),
    "parameters": ("Parameters",),
    "runs.growth": ("Lyapunov", "Multipliers", "Spectrum", "lyapunov", "multipliers", "qr_growth", "spectrum"),
    "runs.outcomes": ("Orbit",),
    "runs.run": ("Run", "load_run"),
    "runs.simulating": ("simulate",),
    "storage.cubefiles": ("open_cube",),
    "studies.attractors": ("attractors",),
    "studies.declared": ("make", "read_declaration"),
    "studies.loops": ("loops",),
    "studies.refine": ("refine",),
    "studies.search": ("search",),
    "studies.sweep": ("bifurcation", "sweep"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}
_MAKES_CUBES = ("bifurcation", "make", "open_cube", "refine", "search", "sweep")


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
