"""Hold the version, and load names of the package when they are first used."""

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

__version__ = "1.0.0"


def reachable(room: str, *modules: str) -> Callable[[str], Any]:
    """Return a `__getattr__` for the module `room`: it imports each of the public `modules` when it is first used."""

    def load(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        return import_module(f"{room}.{name}")

    return load


def _accessor(data: Any) -> Any:
    """Return the accessor of a dataset; its module is imported now, as it needs Numba."""
    return import_module("dimersweep.runs.accessor").DatasetAccessor(data)


class _WithXarray(MetaPathFinder):
    """Finder of modules that registers the accessor `data.dimersweep` when xarray is imported, by whatever program.

    To import xarray for this alone would take half a second.
    """

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Find xarray by the other finders, and register the accessor after it is loaded."""
        if name != "xarray":
            return None
        found = (each.find_spec(name, path, target) for each in sys.meta_path if each is not self)
        spec = next(filter(None, found), None)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def loaded(module: ModuleType) -> None:
                load(module)
                module.register_dataset_accessor("dimersweep")(_accessor)

            setattr(spec.loader, "exec_module", loaded)  # noqa: B010 - to mypy it is no attribute
        return spec


if "xarray" in sys.modules:
    sys.modules["xarray"].register_dataset_accessor("dimersweep")(_accessor)
else:
    sys.meta_path.insert(0, _WithXarray())
