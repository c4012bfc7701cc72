"""The store of a long calculation: one SQLite file beside the output, with its configuration and its finished tiles.

A calculation without an output has an SQLite store in memory.

A process that is killed at any moment leaves a file that SQLite brings back to the last whole transaction. Other damage
is found by checksums, reported, and left out; sound tiles are kept.
"""

import hashlib
import json
import os
import socket
import sqlite3
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from urllib.parse import quote
from uuid import uuid4

from dimersweep.cubes.results import Tile, gaps
from dimersweep.errors import StoreError
from dimersweep.faces import __version__
from dimersweep.kernel.model.layout import CODES, OUT
from dimersweep.storage.files import HALF, delete, disk_errors, replacing, sync
from dimersweep.storage.locking import is_locked, locked
from dimersweep.storage.provenance import as_text, configuration_in, configured, cpu, differences

FORMAT = 4
APPLICATION = 0x64696D65  # "dime", the mark in the head of each store: files without it are never deleted
MAGIC = b"SQLite format 3\0"
# places in the head of a file, as SQLite's file format defines them
PLACE_OF_APPLICATION, PLACE_OF_VERSIONS = slice(68, 72), slice(18, 20)
BUSY_SECONDS = 10.0  # time for which a reader may delay the end of a transaction
NAMED = 5  # damaged tiles that a message names one by one
SCHEMA = (
    "CREATE TABLE about (name TEXT PRIMARY KEY, value)",
    "CREATE TABLE tiles (start INTEGER PRIMARY KEY, stop INTEGER, what TEXT, seconds REAL, wall REAL, at TEXT,"
    " sha256 TEXT, results BLOB)",
)
LAYOUT = json.dumps({"out": list(OUT), "codes": list(CODES)})


class StoredTile(NamedTuple):
    """A finished tile as it is stored.

    Attributes
    ----------
    start, stop : int
        The tile has the points (or parts) `start` to `stop` - 1.
    what : str
        Number of points in each mode, as JSON; for a part of a table, its name.
    seconds, wall : float
        Time of the points of the tile, and of the calculation since the rows before it were written [s].
    at : str
        Time when the tile was written (UTC, ISO 8601).
    sha256 : str
        Checksum of the configuration, of all of the above, and of the results.
    results : bytes or memoryview
        Results in the bytes of their array.
    """

    start: int
    stop: int
    what: str
    seconds: float = 0.0
    wall: float = 0.0
    at: str = ""
    sha256: str = ""
    results: bytes | memoryview = b""


class Store:
    """An open store, see `looked_at` and `opened_store`.

    Parameters
    ----------
    path : Path
        File of the store.
    how : str
        Way to open the file, in the words of an SQLite address (URI).

    Attributes
    ----------
    connection : sqlite3.Connection
        Connection to the file. At the end of its context all changes are on the disk, or none.
    damage : list of str
        Sentences on the damage that was found when the store was opened.
    is_cut : bool
        True if parts of the file could not be read.
    """

    def __init__(self, path: Path, how: str) -> None:
        self.path, self.how = path, how
        self.damage: list[str] = []
        self.is_cut = False
        place = f"file:{quote(os.fsencode(path.absolute()))}?{how}"
        self.connection = sqlite3.connect(place, timeout=BUSY_SECONDS, isolation_level="IMMEDIATE", uri=True)
        self.connection.text_factory = lambda text: text.decode(errors="replace")  # a checksum finds what is damaged
        # a writable schema lets SQLite read a file whose end was cut off
        for setting in ("trusted_schema = OFF", "writable_schema = ON"):
            self.pragma(setting)

    def pragma(self, words: str) -> Any:
        """Return the answer of SQLite to a pragma; None if the file is damaged."""
        try:
            return self.connection.execute(f"PRAGMA {words}").fetchone()
        except sqlite3.OperationalError:  # the disk fails, while its content may be sound
            raise
        except sqlite3.DatabaseError:
            return None

    @cached_property
    def about(self) -> dict[str, Any]:
        """Metadata of the calculation that this store belongs to, by name.

        Raises
        ------
        StoreError
            If they cannot be read, or were written in another version of the format.
        """
        try:
            schema = self.connection.execute("SELECT sql FROM sqlite_master WHERE sql NOT NULL").fetchall()
            about = dict(self.connection.execute("SELECT name, value FROM about"))
            configuration_in(about)
            sound = type(about["points"]) is type(about["wanted"]) is int and 0 < about["wanted"] <= about["points"]
            sound = sound and bool(HALF.fullmatch(about["scratch"]))  # only files with such names are deleted
        except (sqlite3.Error, ValueError, KeyError, TypeError):
            sound = False
        if not sound:
            why = "is damaged, or no store of this version of dimersweep; begin anew (force=True)"
            raise StoreError(f"{self.path}: {why}")
        if schema != [(each,) for each in SCHEMA] or (about.get("format"), about.get("layout")) != (FORMAT, LAYOUT):
            raise StoreError(f"{self.path}: has the format of another version of dimersweep; begin anew (force=True)")
        return about

    @property
    def configuration(self) -> dict[str, Any]:
        """All settings that decide the numbers."""
        return configuration_in(self.about)

    @property
    def size(self) -> int:
        """Number of points or parts."""
        return int(self.about["points"])

    @property
    def scratch(self) -> Path:
        """Temporary path of the output while it is written; the next process deletes what a kill has left there."""
        return self.path.with_name(self.about["scratch"])

    def check_of(self, about: Mapping[str, Any]) -> None:
        """Refuse the store of another calculation than that of the metadata `about`.

        Raises
        ------
        StoreError
            If configurations differ; the message lists the differences.
        """
        if self.about["configuration"] != about["configuration"]:
            found = differences(self.configuration, configuration_in(about))
            changes = "".join(f"\n  {line}" for line in found)
            raise StoreError(
                f"{self.path}: holds results of other settings, stopped before the end; "
                f"begin anew with force=True, or give another output. What differs:{changes}"
            )
        if self.size != about["points"]:
            why = f"tells of {self.size} points, where its grid has {about['points']}"
            raise StoreError(f"{self.path}: is damaged ({why}); begin anew (force=True)")

    def rows(self, columns: str = "*") -> Iterator[StoredTile]:
        """Yield all rows, with default values in columns that are not named.

        Of a damaged file, yield the rows that can be read from its beginning, and then those from its end.
        """
        reached = -1
        try:
            for row in self.connection.execute(f"SELECT {columns} FROM tiles ORDER BY start"):
                reached = row[0]
                yield StoredTile(*row)
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):  # the disk fails, while its content may be sound
                raise
            self.is_cut = True
            with suppress(sqlite3.DatabaseError):
                beyond = f"SELECT {columns} FROM tiles WHERE start > ? ORDER BY start DESC"
                yield from (StoredTile(*row) for row in self.connection.execute(beyond, (reached,)))

    def summaries(self) -> Iterator[StoredTile]:
        """Return all rows without their results and checksums."""
        return self.rows("start, stop, what, seconds, wall, at")

    def gaps(self) -> list[Tile]:
        """Return the ranges of points that the store lacks."""
        return list(gaps(self.size, (Tile(row.start, row.stop) for row in self.summaries())))

    def meeting(self, start: int, stop: int) -> Iterator[StoredTile]:
        """Yield the rows that have points from `start` to `stop` - 1, in order.

        Raises
        ------
        StoreError
            If a row was damaged since the store was opened.
        """
        before = "coalesce((SELECT max(start) FROM tiles WHERE start <= ?), 0)"
        asked = f"SELECT * FROM tiles WHERE start >= {before} AND start < ? AND stop > ? ORDER BY start"
        try:
            found = self.connection.execute(asked, (start, stop, start))
            for row in map(StoredTile._make, found):
                if why := self.why_not(row):
                    raise StoreError(f"{self.path}: {_named(row)} {why}; run the same again")
                yield row
        except sqlite3.DatabaseError as error:
            raise StoreError(f"{self.path}: cannot be read ({error}); run the same again") from None

    def put(self, row: StoredTile) -> None:
        """Add a row, with the present time and its checksum."""
        row = row._replace(at=datetime.now(UTC).isoformat(timespec="seconds"))
        self._insert(row._replace(sha256=self._checksum(row)))

    def _insert(self, row: StoredTile) -> None:
        """Insert a row into the table of tiles, unchecked."""
        self.connection.execute("INSERT INTO tiles VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)

    def take_out(self, start: int) -> None:
        """Remove the row that begins at a point."""
        self.connection.execute("DELETE FROM tiles WHERE start = ?", (start,))

    def tell(self, **about: str | int) -> None:
        """Write metadata into the store, over those of the same names."""
        self.connection.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", about.items())
        self.about.update(about)

    def _checksum(self, row: StoredTile) -> str:
        """Return the checksum of a row: of the configuration, of its columns before `sha256`, and of its results."""
        sha256 = hashlib.sha256(json.dumps([self.about["configuration_sha256"], *row[:6]]).encode())
        sha256.update(row.results)
        return sha256.hexdigest()

    def why_not(self, row: StoredTile) -> str:
        """Return the reason why the results of a row must not be used; "" if they may be."""
        try:
            if self._checksum(row) != row.sha256:
                return "has other bytes than were written"
            sound = 0 <= row.start < row.stop <= self.size and row.seconds + row.wall >= 0
            return "" if sound else "is not of this grid"
        except TypeError:  # a damaged column has a value of another type
            return "has other bytes than were written"

    def is_empty(self) -> bool:
        """Return True if the store has no finished tile."""
        return next(self.summaries(), None) is None

    def is_new(self) -> bool:
        """Return True if the file has no page yet, so that nothing was ever written to it."""
        return bool(self.pragma("page_count") == (0,))

    def begin(self, about: Mapping[str, Any]) -> None:
        """Make the tables of a new store, with the metadata `about`.

        Raises
        ------
        sqlite3.Error, OSError
            If the disk refuses.
        """
        with self.connection:
            for statement in ("BEGIN IMMEDIATE", f"PRAGMA application_id = {APPLICATION}", *SCHEMA):
                self.connection.execute(statement)
            self.connection.executemany("INSERT INTO about VALUES (?, ?)", about.items())

    def mended(self) -> list[str]:
        """Replace a damaged file by one with all sound rows, and return sentences on the damage.

        The list is empty if there is no damage. Otherwise this store must be closed, as it is that of the former file.
        """
        damage = [f"{_named(row)} {why}" for row in self.rows() if (why := self.why_not(row))]
        if self.is_cut or self.pragma("quick_check(1)") != ("ok",):
            damage.append("parts of the file cannot be read")
        if not damage:
            return []
        with replacing(self.path, self.scratch) as scratch, closing(Store(scratch, self.how)) as other:
            other.begin(self.about)
            with other.connection:
                for row in self.rows():
                    if not self.why_not(row):
                        other._insert(row)
        if len(damage) > NAMED:
            damage = [*damage[:NAMED], f"and {len(damage) - NAMED} more"]
        return [f"{self.path}: damaged results are computed again ({'; '.join(damage)})"]

    def close(self) -> None:
        """Close the file."""
        self.connection.close()

    def remove(self) -> None:
        """Delete the file, and an output that a kill has left half written."""
        with suppress(StoreError):
            delete(self.scratch)
        self.close()
        for ending in ("-journal", "-wal", "-shm", ""):  # logs -wal and -shm exist if a damaged head has asked for them
            delete(self.path.with_name(self.path.name + ending))


AnyStore = TypeVar("AnyStore", bound=Store)
Maker = Callable[[Path, str], AnyStore]


def _named(row: StoredTile) -> str:
    """Return the name of a tile in messages."""
    return f"tile {row.start}"  # without its end, which may be damaged, too


def _refuse_others(path: Path) -> None:
    """Refuse a folder, a link or a device at the path of a store; former versions kept tiles in a folder.

    Raises
    ------
    StoreError
        If there is a folder, a link or a device.
    """
    if os.path.lexists(path) and (path.is_symlink() or not path.is_file()):
        raise StoreError(f"{path}: is no file, where what is finished is kept; move it, or give another output")


@contextmanager
def looked_at(path: Path) -> Iterator[Store]:
    """Open the store at `path` to read it only; another process may be at work there.

    Raises
    ------
    StoreError
        If there is no store, or it cannot be read.
    """
    _refuse_others(path)
    try:
        store = Store(path, "mode=ro")
        try:
            store.is_new()
        except sqlite3.OperationalError:  # a transaction was left half done, which only a writer may undo
            store.close()
            store = Store(path, "mode=ro&immutable=1")
        with closing(store):
            if store.is_new():
                raise StoreError(f"{path}: nothing is kept there yet")
            yield store
    except sqlite3.Error as error:
        raise StoreError(f"{path}: cannot be read ({error})") from None


def finished_at(path: Path, configuration: Mapping[str, Any]) -> list[StoredTile]:
    """Return the finished tiles at `path`, without results, if they have this configuration; raise as `looked_at`."""
    if not path.exists():
        return []
    with looked_at(path) as store:
        return list(store.summaries()) if store.about["configuration"] == as_text(configuration) else []


def holder(path: Path) -> str:
    """Return a description of the process at work at the store `path`; "" if there is none."""
    if not is_locked(path):
        return ""
    try:
        with looked_at(path) as store:
            return "process {process} on {host}, since {since}".format_map(store.about)
    except (StoreError, KeyError):  # the process has not written its name yet
        return "another process"


@contextmanager
def _owned(make: Maker[AnyStore], path: Path) -> Iterator[AnyStore]:
    """Open the store at `path`, locked against other processes while the context lasts.

    Raises
    ------
    StoreError
        If another process has the lock (the message names it), or there is a file of somebody else.
    """
    _refuse_others(path)
    with ExitStack() as stack:
        try:
            head, honest = stack.enter_context(locked(path))
        except BlockingIOError:
            who = holder(path)
            raise StoreError(f"{path}: a sweep is at work here ({who}); wait for it or stop it first") from None
        if not honest:
            message = "this file system has no locks; take care that no other sweep writes to the same output"
            warnings.warn(message, RuntimeWarning, stacklevel=2)
        # a file with the mark of a store, or too short for one, may be deleted, whether it is damaged or not
        short = len(head) < PLACE_OF_APPLICATION.stop and MAGIC.startswith(head[: len(MAGIC)])
        if not short and head[PLACE_OF_APPLICATION] != APPLICATION.to_bytes(4):
            other = "lacks the mark of dimersweep, where what is finished is kept"
            raise StoreError(f"{path}: {other}; move it, or give another output")
        store = stack.enter_context(closing(make(path, "mode=rwc" if honest else "mode=rwc&nolock=1")))
        store.is_cut = not short and head[PLACE_OF_VERSIONS] != b"\1\1"  # SQLite refuses to write to other versions
        yield store


@contextmanager
def opened_store(
    make: Maker[AnyStore], path: Path | None, configuration: Mapping[str, Any], size: int, *, force: bool = False
) -> Iterator[AnyStore]:
    """Open the store of this configuration, locked against other processes while the context lasts.

    If the context ends with an error, and no tile was finished, the file is deleted.

    Parameters
    ----------
    make : callable
        `Store`, or a callable that makes a store from the same parameters.
    path : Path, optional
        File of the store; by default it is in memory.
    configuration : mapping
        All settings that decide the numbers, as JSON can hold them.
    size : int
        Number of points or parts.
    force : bool
        If True, results of another configuration, or a damaged store, may be deleted. Sound results of this very
        configuration are kept all the same.

    Raises
    ------
    StoreError
        If another process is at work there, the store has another configuration (the message lists the differences), or
        the file cannot be written.
    """
    about = _about(configuration, size)
    if path is None:
        with closing(make(Path(":memory:"), "mode=memory")) as store:
            store.begin(about)
            yield store
        return
    with ExitStack() as stack:
        with disk_errors(f"{path}", "nothing was computed"):
            damage = _mended(make, path, about, force=force)
            store = stack.enter_context(_owned(make, path))
            for setting in ("writable_schema = OFF", "synchronous = FULL"):
                store.pragma(setting)
            if store.is_new():
                store.begin(about)
                sync(path.parent)  # the new name must outlive a power cut
            store.check_of(about)
            store.damage = damage
            delete(store.scratch)
            with store.connection:
                store.tell(process=os.getpid(), host=socket.gethostname(), since=time.strftime("%Y-%m-%d %H:%M:%S"))
        try:
            yield store
        except BaseException:
            with suppress(OSError, sqlite3.Error):
                if store.is_empty():
                    store.remove()
            raise


def _mended(make: Maker[Store], path: Path, about: Mapping[str, Any], *, force: bool) -> list[str]:
    """Mend the store at `path`, if it has this configuration, and return sentences on its damage."""
    with _owned(make, path) as store:
        try:
            if store.is_new():
                return []
            store.check_of(about)
            return store.mended()
        except StoreError:
            if not force:
                raise
            store.remove()
            return []


def _about(configuration: Mapping[str, Any], size: int) -> dict[str, Any]:
    """Return the metadata of a new store."""
    return {
        "format": FORMAT,
        "layout": LAYOUT,
        "dimersweep": __version__,
        "kernel_version": configuration["kernel_version"],
        **configured(configuration),
        "points": size,
        "wanted": size,
        "cpu": cpu(),
        "scratch": f".dimersweep-{uuid4().hex}.tmp",
    }
