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

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

from dimersweep.faces import __version__ as __version__

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
_TOLD = [(each.module, name) for each in _STUB if isinstance(each, ast.ImportFrom) for name in each.names]
# of each public name: the module that it is imported from, and its name there
_HOME = {name.asname: (module, name.name) for module, name in _TOLD if name.asname}
_HOME["stability"] = ("dimersweep.runs", "growth")

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    # importing Numba and xarray takes a second or two: pay it with the first name that needs them (PEP 562)
    if name not in _HOME:
        raise AttributeError(f"module 'dimersweep' has no attribute {name!r}")
    module, there = _HOME[name]
    value = import_module(f"{module}.{there}") if module == __name__ else getattr(import_module(module), there)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
