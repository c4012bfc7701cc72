"""What a sweep has finished, on disk: a line of JSON for the sweep and one for every file of results, each with a checksum."""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any, BinaryIO

from dimersweep.cubes.results import Tile
from dimersweep.errors import StoreError
from dimersweep.faces import __version__
from dimersweep.kernel.model.layout import CODES, MODES, OUT
from dimersweep.storage.provenance import as_text, digest

FORMAT = 3
_CHECK = ', "check": '  # the last key of every line: of all that comes before it
_LAYOUT = {"out": list(OUT), "codes": list(CODES)}


@dataclass(frozen=True)
class Entry:
    """One file of results.

    Parameters
    ----------
    file : str
        Its name in the folder of the manifest.
    tiles : list of Tile
        Points it holds, one range after the other.
    size, sha256 : int, str
        Of its bytes.
    configuration_sha256 : str
        The configuration that gave it.
    modes : dict of str to int
        Tally of its points.
    seconds : float
        Sum of the times of its tiles [s].
    wall : float
        Time of the sweep since the entry before [s].
    time : str
        When it was written, UTC.
    """

    file: str
    tiles: list[Tile]
    size: int
    sha256: str
    configuration_sha256: str
    modes: dict[str, int]
    seconds: float = 0.0
    wall: float = 0.0
    time: str = ""

    @property
    def points(self) -> int:
        """Number of points it holds."""
        return sum(stop - start for start, stop in self.tiles)


@dataclass
class Manifest:
    """A manifest as it was read.

    Parameters
    ----------
    configuration : dict
        See ``Spec.configuration``; the coordinates of every point are here, and nowhere else.
    size : int
        Number of points of the grid.
    cpu : str
        Processor of the process that began it.
    entries : list of Entry
        Files of results.
    wanted : int
        Points that are to be run: all of a sweep, but for a map that is refined, those known to be needed so far.
    damaged : int
        Lines that could not be read; the last one is cut where a sweep was killed while it wrote.
    length : int
        Bytes up to and with the last line that could be read.
    """

    configuration: dict[str, Any]
    size: int
    cpu: str
    entries: list[Entry]
    wanted: int
    damaged: int = 0
    length: int = 0

    @cached_property
    def sha256(self) -> str:
        """Of the configuration."""
        return digest(as_text(self.configuration))

    @property
    def done(self) -> int:
        """Number of points with results."""
        return sum(entry.points for entry in self.entries)

    @property
    def words(self) -> str:
        """How far it is, such as ``12 of 132 points``."""
        return self.words_for(self.done)

    def words_for(self, done: int) -> str:
        """In words, for so many points that are done."""
        more = " known to be needed so far" if "refine" in self.configuration else ""
        return f"{done} of {self.wanted} points{more}"


def _head(configuration: Mapping[str, Any], size: int, cpu: str) -> dict[str, Any]:
    return {
        "dimersweep_manifest": FORMAT,
        "dimersweep": __version__,
        "kernel_version": configuration["kernel_version"],
        "configuration": configuration,
        "configuration_sha256": digest(as_text(configuration)),
        "points": size,
        "cpu": cpu,
        "layout": _LAYOUT,
    }


def as_line(record: Mapping[str, Any] | Entry) -> bytes:
    """One line of a manifest."""
    text = json.dumps(vars(record) if isinstance(record, Entry) else record)[:-1]
    return f"{text}{_CHECK}{_ending(text)}".encode()


def _ending(text: str) -> str:
    return f'"{digest(text)[:16]}"}}\n'


def _parsed(line: bytes) -> dict[str, Any] | None:
    """What `line` tells; None if it is not as it was written."""
    try:
        text, _, ending = line.decode().rpartition(_CHECK)
        parsed = json.loads(text + "}") if ending == _ending(text) else None
    except (ValueError, RecursionError):
        return None
    return parsed if isinstance(parsed, dict) else None


def wanted_line(wanted: int) -> bytes:
    """The line that tells how many points are to be run."""
    return as_line({"wanted": wanted})


def lines(manifest: Manifest) -> bytes:
    """A whole manifest."""
    head = as_line(_head(manifest.configuration, manifest.size, manifest.cpu))
    wanted = wanted_line(manifest.wanted) if manifest.wanted != manifest.size else b""
    return head + wanted + b"".join(map(as_line, manifest.entries))


def _entry(parsed: dict[str, Any], manifest: Manifest) -> Entry | None:
    try:
        entry = Entry(**parsed | {"tiles": [Tile(*map(int, pair)) for pair in parsed["tiles"]]})
        sound = all(0 <= start < stop <= manifest.size for start, stop in entry.tiles)
        sound = sound and entry.configuration_sha256 == manifest.sha256 and os.path.basename(entry.file) == entry.file
        sound = sound and set(entry.modes) <= set(MODES) and sum(entry.modes.values()) == entry.points
        sound = sound and isfinite(entry.seconds) and isfinite(entry.wall)
        sound = sound and datetime.fromisoformat(entry.time).tzinfo is not None
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError):
        return None
    return entry if sound else None


def _take(line: bytes, manifest: Manifest, take: Callable[[Entry], None]) -> bool:
    """Enter what a line after the first tells into `manifest`, or hand it to `take`; whether it could be read."""
    parsed = _parsed(line)
    if parsed is None:
        return False
    if set(parsed) == {"wanted"}:
        sound = type(parsed["wanted"]) is int and 0 < parsed["wanted"] <= manifest.size
        manifest.wanted = parsed["wanted"] if sound else manifest.wanted
        return sound
    entry = _entry(parsed, manifest)
    if entry is not None:
        take(entry)
    return entry is not None


def _begun(head: dict[str, Any], length: int) -> Manifest | None:
    """A manifest without entries, as its first line tells; None if that makes no sense."""
    try:
        configuration, size, cpu = (head[name] for name in ("configuration", "points", "cpu"))
        manifest = Manifest(configuration, size, cpu, [], size, length=length)
        sound = isinstance(configuration, dict) and type(size) is int and size > 0 and isinstance(cpu, str)
        return manifest if sound and head["configuration_sha256"] == manifest.sha256 else None
    except (TypeError, KeyError, RecursionError):
        return None


def read_manifest(path: Path, take: Callable[[Entry], None] | None = None) -> Manifest:
    """Read a manifest, leaving out the entries that are damaged.

    Parameters
    ----------
    path : Path
    take : callable, optional
        Is given the entries one by one, in place of the manifest, which may be too long to be held.

    Raises
    ------
    StoreError
        If its head cannot be read, or was written by another version of the format.
    OSError
        If it is not there.
    """
    with path.open("rb") as file:
        return _read(path, file, take)


def _read(path: Path, rest: BinaryIO, take: Callable[[Entry], None] | None) -> Manifest:
    first = rest.readline()
    head = _parsed(first)
    manifest = _begun(head, len(first)) if head else None
    if head is None or manifest is None:
        raise StoreError(f"{path}: is damaged, or no manifest of this version of dimersweep; begin anew (force=True)")
    if (head.get("dimersweep_manifest"), head.get("layout")) != (FORMAT, _LAYOUT):
        raise StoreError(f"{path}: has the format of another version of dimersweep; begin anew (force=True)")
    for line in rest:
        if not (line.endswith(b"\n") and _take(line, manifest, take or manifest.entries.append)):
            manifest.damaged += 1
        manifest.length += len(line) if line.endswith(b"\n") else 0
    return manifest
