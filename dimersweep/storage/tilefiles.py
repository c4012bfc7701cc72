"""Files of finished points: written whole, and put to every check before they are used."""

import hashlib
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path

import numpy as np

from dimersweep.cubes.results import Finished, Tile, tally
from dimersweep.kernel.model.layout import CODE_MODE, M_NOT_RUN, MODES
from dimersweep.storage.files import put
from dimersweep.storage.manifest import Entry


class Damaged(Exception):
    """A file of results that must not be used."""


def joined(tiles: Iterable[Tile]) -> list[Tile]:
    """Sorted `tiles` with those that touch made one."""
    whole: list[Tile] = []
    for start, stop in tiles:
        joins = whole and whole[-1].stop == start
        whole.append(Tile(whole.pop().start if joins else start, stop))
    return whole


def _header(pieces: Sequence[Finished]) -> bytes:
    """What a file of NumPy's begins with that holds the results of `pieces`."""
    kind, points = pieces[0].results.dtype, sum(len(finished.results) for finished in pieces)
    header = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": (points,)}
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, header)
    return buffer.getvalue()


def write_points(path: Path, pieces: Sequence[Finished], configuration_sha256: str, wall: float) -> Entry:
    """Write the results of `pieces` to one file.

    Returns
    -------
    Entry
        What the manifest must tell of it.

    Raises
    ------
    OSError
        If the disk refuses.
    """
    pieces = sorted(pieces, key=lambda finished: finished.tile)
    sha256, size, modes = hashlib.sha256(), 0, Counter[str]()

    def parts() -> Iterator[memoryview]:
        nonlocal size
        contents = (np.ascontiguousarray(finished.results).view(np.uint8) for finished in pieces)
        for part in chain([memoryview(_header(pieces))], (content.data for content in contents)):
            sha256.update(part)
            size += len(part)
            yield part

    put(path, parts())
    for finished in pieces:
        modes.update(tally(finished.codes))
    return Entry(
        file=path.name,
        tiles=joined(finished.tile for finished in pieces),
        size=size,
        sha256=sha256.hexdigest(),
        configuration_sha256=configuration_sha256,
        modes=dict(modes),
        seconds=sum(finished.seconds for finished in pieces),
        wall=wall,
        time=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def read_points(folder: Path, entry: Entry, kind: np.dtype) -> list[Finished]:
    """The results of one file, each point of `kind`, range by range, after every check that it can be put to.

    Raises
    ------
    Damaged
        Saying why it must not be used.
    """
    try:
        written = (folder / entry.file).read_bytes()
    except OSError as error:
        raise Damaged(f"cannot be read ({error.strerror})") from None
    if len(written) != entry.size:
        raise Damaged(f"has {len(written)} bytes in place of {entry.size}")
    if hashlib.sha256(written).hexdigest() != entry.sha256:
        raise Damaged("has other bytes than were written")
    buffer = io.BytesIO(written)
    try:
        np.lib.format.read_magic(buffer)
        shape, _, dtype = np.lib.format.read_array_header_1_0(buffer)
    except (ValueError, EOFError):
        raise Damaged("is no file of results") from None
    if dtype != kind or shape != (entry.points,) or entry.size - buffer.tell() != entry.points * kind.itemsize:
        raise Damaged("has results of another shape")
    points = np.frombuffer(written, kind, offset=buffer.tell())  # no copy, as files may be large
    modes = points["codes"][:, CODE_MODE]
    if (modes == M_NOT_RUN).any():
        raise Damaged("has points that were not run")
    if (modes.size and not 0 <= modes.min() <= modes.max() < len(MODES)) or tally(points["codes"]) != entry.modes:
        raise Damaged("has other modes than were listed")
    ends = np.cumsum([stop - start for start, stop in entry.tiles])
    parts = np.split(points, ends[:-1])
    return [Finished(tile, part) for tile, part in zip(entry.tiles, parts, strict=True)]
