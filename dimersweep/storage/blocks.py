"""Blocks of points: the ranges in which cubes larger than memory are read and written."""

from collections.abc import Iterator
from itertools import product
from math import prod

from dimersweep.cubes.results import Tile

CHUNK_POINTS = 1 << 18  # points of a chunk: 2 MB for a variable of floats


def chunk_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape of chunks that are ranges of points in C order.

    They have whole last axes, a part of one axis, and single values of the first axes.
    """
    chunks, room = [], CHUNK_POINTS
    for length in reversed(shape):
        chunks.append(max(1, min(length, room)))
        room //= max(1, length)
    return tuple(reversed(chunks))


def blocks(shape: tuple[int, ...]) -> Iterator[tuple[Tile, tuple[slice, ...]]]:
    """Yield the range of points of each chunk, and its slices along the axes."""
    axes = zip(shape, chunk_shape(shape), strict=True)
    start = 0
    for where in product(*([slice(at, min(at + chunk, n)) for at in range(0, n, chunk)] for n, chunk in axes)):
        stop = start + prod(part.stop - part.start for part in where)
        yield Tile(start, stop), where
        start = stop
