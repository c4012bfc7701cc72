"""Blocks of points: the ranges in which cubes larger than memory are read and written."""

from collections.abc import Iterator
from math import prod

import numpy as np

from dimersweep.cubes.results import Tile

CHUNK_POINTS = 1 << 18  # 2 MB a variable and chunk


def chunk_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Chunks that are ranges of points in C order: whole last axes, a part of one, and single values of the first ones."""
    chunks, room = [], CHUNK_POINTS
    for length in reversed(shape):
        chunks.append(min(length, max(1, room)))
        room = room // length if room >= length else 0
    return tuple(reversed(chunks))


def blocks(shape: tuple[int, ...]) -> Iterator[tuple[Tile, tuple[slice, ...]]]:
    """The range of points of each chunk, and where it lies along each axis."""
    chunks = chunk_shape(shape)
    counts = [-(-length // chunk) for length, chunk in zip(shape, chunks, strict=True)]
    start = 0
    for place in np.ndindex(*counts):
        where = tuple(
            slice(k * chunk, min((k + 1) * chunk, length))
            for k, chunk, length in zip(place, chunks, shape, strict=True)
        )
        stop = start + prod(part.stop - part.start for part in where)
        yield Tile(start, stop), where
        start = stop
