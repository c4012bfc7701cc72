"""Records: named numbers in memory, which the kernel passes by their address.

A tuple is passed by its values: passing forty numbers costs more than many a function that takes them.
"""

from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

import numba
import numpy as np

Fields = TypeVar("Fields")
_config: Any = numba.config
NUMBERS = (bool, int, float)
ROW = 24  # entries of a row of scratch: more than any state has, and whole lines of the cache (8 entries each)
Row = Annotated[list[float], ROW]


@cache  # the search of an orbit makes thousands of records
def record_type(fields: type) -> np.dtype:
    """Return the type in memory of a class of named numbers.

    Its fields are numbers, further such classes, or lists of either, `Annotated` with their length.
    """
    kinds = get_type_hints(fields, include_extras=True).items()
    return np.dtype((np.record, np.dtype([(name, _type_of(kind)) for name, kind in kinds], align=True)))


def _type_of(kind: Any) -> Any:
    if hasattr(kind, "__metadata__"):
        return _type_of(get_args(kind.__origin__)[0]), kind.__metadata__
    return kind if kind in NUMBERS else record_type(kind)


def one(fields: type[Fields]) -> Sequence[Fields]:
    """Return an array of one record of a class, with all its numbers zero.

    With the JIT off it is a list of one plain object instead, which Python reads thirty times as fast.
    """
    records: Any = np.zeros(1, record_type(fields))  # type: ignore[arg-type]  # a class is hashable: mypy 11469
    return [as_object(records[0])] if _config.DISABLE_JIT else records


def new_record(fields: type[Fields]) -> Fields:
    """Return a record of a class with all its numbers zero, to be filled in place."""
    return one(fields)[0]


def as_object(record: Any) -> Any:
    """Return a record as a plain object: Python reads it faster, and compiled code does not take it.

    Numbers and records within it are copied; of its arrays the object has views.
    """
    if isinstance(record, np.void):
        return SimpleNamespace(**{name: as_object(record[name]) for name in record.dtype.names or ()})
    return record.item() if isinstance(record, np.generic) else record
