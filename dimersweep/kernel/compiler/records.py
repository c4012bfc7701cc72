"""Records: named numbers in memory, which the kernel hands on by their address.

A tuple goes from function to function by its values: one of forty numbers costs more than many a function that takes it.
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
ROW = 24  # entries of a row of scratch, more than any state has: whole lines of the cache
Row = Annotated[list[float], ROW]


@cache  # a search of an orbit makes thousands of records
def record_type(fields: type) -> np.dtype:
    """The type in memory of a class of named numbers, further such classes, and `Annotated` lists of either, by length."""
    kinds = get_type_hints(fields, include_extras=True).items()
    return np.dtype((np.record, np.dtype([(name, _type_of(kind)) for name, kind in kinds], align=True)))


def _type_of(kind: Any) -> Any:
    if hasattr(kind, "__metadata__"):
        return _type_of(get_args(kind.__origin__)[0]), kind.__metadata__
    return kind if kind in NUMBERS else record_type(kind)


def one(fields: type[Fields]) -> Sequence[Fields]:
    """An array of one record of this class with all its numbers zero.

    With the JIT off it is a list of a plain object, which Python reads thirty times as fast.
    """
    records: Any = np.zeros(1, record_type(fields))  # type: ignore[arg-type]  # a class is hashable: mypy 11469
    return [as_object(records[0])] if _config.DISABLE_JIT else records


def new_record(fields: type[Fields]) -> Fields:
    """A record of this class with all its numbers zero, to be filled in place."""
    return one(fields)[0]


def as_object(record: Any) -> Any:
    """A record as a plain object, see `one`: a copy, which Python reads and compiled code does not take.

    What is in it comes out likewise, but for its arrays, of which it has a view.
    """
    if isinstance(record, np.void):
        return SimpleNamespace(**{name: as_object(record[name]) for name in record.dtype.names or ()})
    return record.item() if isinstance(record, np.generic) else record
