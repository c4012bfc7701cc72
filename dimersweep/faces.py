"""What the faces of the package and of its rooms share: the version, and names that are loaded when they are asked for."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

__version__ = "0.1.0"


def reachable(room: str, *modules: str) -> Callable[[str], Any]:
    """A `__getattr__` for a room some of whose modules are public: each is loaded when it is asked for."""

    def load(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        return import_module(f"{room}.{name}")

    return load
