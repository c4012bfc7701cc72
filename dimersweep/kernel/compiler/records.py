"""Records: named numbers in memory, which the kernel hands on by their address.

A tuple goes from function to function by its values: one of forty numbers costs more than many a function that takes it.
"""

from types import SimpleNamespace
from typing import Any, TypeVar, get_type_hints

import numba
import numpy as np

Fields = TypeVar("Fields")
_config: Any = numba.config


def record_type(fields: type) -> np.dtype:
    """The type in memory of a class of named numbers and further such classes."""
    kinds = [
        (name, kind if kind in (bool, int, float) else record_type(kind))
        for name, kind in get_type_hints(fields).items()
    ]
    return np.dtype((np.record, np.dtype(kinds, align=True)))


def new_record(fields: type[Fields]) -> Fields:
    """A record of this class with all its numbers zero, to be filled in place.

    With the JIT off it is a plain object, which Python reads thirty times as fast.
    """
    if _config.DISABLE_JIT:
        parts = get_type_hints(fields).items()
        plain: Any = SimpleNamespace(
            **{k: kind(0) if kind in (bool, int, float) else new_record(kind) for k, kind in parts}
        )
        return plain
    record: Any = np.zeros(1, record_type(fields))[0]
    return record
