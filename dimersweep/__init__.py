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
from typing import Any

from dimersweep.faces import __version__ as __version__

# where each public name stands: a module, or a module and the name in it; `__init__.pyi` says the same to type checkers
_HOME = {
    "Lyapunov": "dimersweep.runs.growth:Lyapunov",
    "Minimum": "dimersweep.cubes.findings:Minimum",
    "Multipliers": "dimersweep.runs.growth:Multipliers",
    "Orbit": "dimersweep.runs.outcomes:Orbit",
    "ParameterError": "dimersweep.errors:ParameterError",
    "Parameters": "dimersweep.parameters:Parameters",
    "PointError": "dimersweep.errors:PointError",
    "PowerLaw": "dimersweep.cubes.findings:PowerLaw",
    "Run": "dimersweep.runs.run:Run",
    "Spectrum": "dimersweep.runs.growth:Spectrum",
    "Stopped": "dimersweep.errors:Stopped",
    "StoreError": "dimersweep.errors:StoreError",
    "attractors": "dimersweep.analysis.attractors.shares:attractors",
    "bifurcation": "dimersweep.studies.sweep:bifurcation",
    "boundary": "dimersweep.cubes.findings:boundary",
    "circle_through": "dimersweep.cubes.findings:circle_through",
    "cubes": "dimersweep.cubes",
    "drift_intervals": "dimersweep.cubes.findings:drift_intervals",
    "drift_lengths": "dimersweep.cubes.findings:drift_lengths",
    "errors": "dimersweep.errors",
    "explore": "dimersweep.exploring.serving:explore",
    "exponents": "dimersweep.cubes.findings:exponents",
    "fit": "dimersweep.analysis.fits.fitting:fit",
    "fits": "dimersweep.fits",
    "load_run": "dimersweep.runs.run:load_run",
    "loops": "dimersweep.studies.loops:loops",
    "lyapunov": "dimersweep.runs.growth:lyapunov",
    "make": "dimersweep.studies.declared:make",
    "merge": "dimersweep.studies.merging:merge",
    "minimum": "dimersweep.cubes.findings:minimum",
    "multipliers": "dimersweep.runs.growth:multipliers",
    "names": "dimersweep.cubes.cube:names",
    "observer": "dimersweep.studies.observing:observer",
    "open_cube": "dimersweep.storage.cubefiles:open_cube",
    "orbits": "dimersweep.orbits",
    "plots": "dimersweep.plots",
    "qr_growth": "dimersweep.runs.growth:qr_growth",
    "read_declaration": "dimersweep.studies.declared:read_declaration",
    "refine": "dimersweep.studies.refine:refine",
    "runs": "dimersweep.runs",
    "runs_of": "dimersweep.cubes.findings:runs_of",
    "search": "dimersweep.studies.search:search",
    "simulate": "dimersweep.runs.simulating:simulate",
    "spectrum": "dimersweep.runs.growth:spectrum",
    "stability": "dimersweep.runs.growth",
    "stick_ratio": "dimersweep.cubes.findings:stick_ratio",
    "studies": "dimersweep.studies",
    "sweep": "dimersweep.studies.sweep:sweep",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    # importing Numba and xarray takes a second or two: pay it with the first name that needs them (PEP 562)
    if name not in _HOME:
        raise AttributeError(f"module 'dimersweep' has no attribute {name!r}")
    module, _, there = _HOME[name].partition(":")
    value = getattr(import_module(module), there) if there else import_module(module)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
