"""The store of a long calculation: one SQLite file beside its output, with what it is of and what is finished of it.

Of a calculation without an output it is one of SQLite's in memory.

What a process killed at any moment leaves behind is a file that SQLite brings back to its last whole transaction. What is
damaged by other means is found by checksums, named, and left out; the rest is kept.
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
APPLICATION = 0x64696D65  # in the head of each of our files: others are never deleted
MAGIC = b"SQLite format 3\0"
PLACE_OF_APPLICATION, PLACE_OF_VERSIONS = slice(68, 72), slice(18, 20)  # in the first bytes of a file
BUSY_SECONDS = 10.0  # that a reader may hold up the end of a transaction
NAMED = 5  # damaged tiles that are named one by one
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
        The points or parts `start` to `stop` - 1.
    what : str
        How many points are in each mode, as JSON; of a part, its name.
    seconds, wall : float
        Time of its points, and of the calculation since the rows before it were written [s].
    at : str
        When it was written, UTC.
    sha256 : str
        Of the configuration, all of the above, and the results.
    results : bytes or memoryview
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
    """A store that is open, see `looked_at` and `opened_store`.

    Parameters
    ----------
    path : Path
    how : str
        How it is opened, as in the address of an SQLite file.

    Attributes
    ----------
    connection : sqlite3.Connection
        What is changed in its context is on the disk at the end of that, or nothing of it is.
    trouble : list of str
        What was damaged when it was opened, in words.
    is_cut : bool
        Whether parts of it could not be read.
    """

    def __init__(self, path: Path, how: str) -> None:
        self.path, self.how = path, how
        self.trouble: list[str] = []
        self.is_cut = False
        place = f"file:{quote(os.fsencode(path.absolute()))}?{how}"
        self.connection = sqlite3.connect(place, timeout=BUSY_SECONDS, isolation_level="IMMEDIATE", uri=True)
        self.connection.text_factory = lambda text: text.decode(errors="replace")  # a checksum finds what is damaged
        # the second one lets a file be read from which the end was cut
        for setting in ("trusted_schema = OFF", "writable_schema = ON"):
            self.pragma(setting)

    def pragma(self, words: str) -> Any:
        """What SQLite answers to a pragma; None of a file that is damaged."""
        try:
            return self.connection.execute(f"PRAGMA {words}").fetchone()
        except sqlite3.OperationalError:  # of the disk, not of what is on it
            raise
        except sqlite3.DatabaseError:
            return None

    @cached_property
    def about(self) -> dict[str, Any]:
        """What it is of.

        Raises
        ------
        StoreError
            If that cannot be read, or was written by another version of the format.
        """
        try:
            schema = self.connection.execute("SELECT sql FROM sqlite_master WHERE sql NOT NULL").fetchall()
            about = dict(self.connection.execute("SELECT name, value FROM about"))
            configuration_in(about)
            sound = type(about["points"]) is type(about["wanted"]) is int and 0 < about["wanted"] <= about["points"]
            sound = sound and bool(HALF.fullmatch(about["scratch"]))  # nothing else is ever deleted
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
        """All that decides the numbers."""
        return configuration_in(self.about)

    @property
    def size(self) -> int:
        """Number of points or parts."""
        return int(self.about["points"])

    @property
    def scratch(self) -> Path:
        """Where the output is written before it takes its name: the next process deletes what a kill has left there."""
        return self.path.with_name(self.about["scratch"])

    def check_of(self, about: Mapping[str, Any]) -> None:
        """Refuse a store of something else.

        Raises
        ------
        StoreError
            With what differs.
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
        """All rows, without the columns that are not named; of a damaged file those that can be read, from both ends."""
        reached = -1
        try:
            for row in self.connection.execute(f"SELECT {columns} FROM tiles ORDER BY start"):
                reached = row[0]
                yield StoredTile(*row)
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):  # of the disk, not of what is on it
                raise
            self.is_cut = True
            with suppress(sqlite3.DatabaseError):
                beyond = f"SELECT {columns} FROM tiles WHERE start > ? ORDER BY start DESC"
                yield from (StoredTile(*row) for row in self.connection.execute(beyond, (reached,)))

    def summaries(self) -> Iterator[StoredTile]:
        """All rows without their results and checksums."""
        return self.rows("start, stop, what, seconds, wall, at")

    def gaps(self) -> list[Tile]:
        """The ranges that are not yet on disk."""
        return list(gaps(self.size, (Tile(row.start, row.stop) for row in self.summaries())))

    def meeting(self, start: int, stop: int) -> Iterator[StoredTile]:
        """The rows that have points from `start` to `stop` - 1, in order.

        Raises
        ------
        StoreError
            If one was damaged since the store was opened.
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
        """Add a row, with the time and its checksum."""
        row = row._replace(at=datetime.now(UTC).isoformat(timespec="seconds"))
        self._insert(row._replace(sha256=self._checksum(row)))

    def _insert(self, row: StoredTile) -> None:
        self.connection.execute("INSERT INTO tiles VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)

    def take_out(self, start: int) -> None:
        """Remove the row that begins at a point."""
        self.connection.execute("DELETE FROM tiles WHERE start = ?", (start,))

    def tell(self, **about: str | int) -> None:
        """Change what is written of the store."""
        self.connection.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", about.items())
        self.about.update(about)

    def _checksum(self, row: StoredTile) -> str:
        sha256 = hashlib.sha256(json.dumps([self.about["configuration_sha256"], *row[:6]]).encode())
        sha256.update(row.results)
        return sha256.hexdigest()

    def why_not(self, row: StoredTile) -> str:
        """Why the results of a row must not be used; "" if they may."""
        try:
            if self._checksum(row) != row.sha256:
                return "has other bytes than were written"
            sound = 0 <= row.start < row.stop <= self.size and row.seconds + row.wall >= 0
            return "" if sound else "is not of this grid"
        except TypeError:  # of a column that holds what it cannot
            return "has other bytes than were written"

    def is_empty(self) -> bool:
        """Whether nothing is finished."""
        return next(self.summaries(), None) is None

    def is_new(self) -> bool:
        """Whether nothing was ever written there."""
        return bool(self.pragma("page_count") == (0,))

    def begin(self, about: Mapping[str, Any]) -> None:
        """Make the tables of a new store.

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
        """What is damaged, in words; a file with all that is whole is then in place of this one, which is to be closed."""
        trouble = [f"{_named(row)} {why}" for row in self.rows() if (why := self.why_not(row))]
        if self.is_cut or self.pragma("quick_check(1)") != ("ok",):
            trouble.append("parts of the file cannot be read")
        if not trouble:
            return []
        with replacing(self.path, self.scratch) as scratch, closing(Store(scratch, self.how)) as other:
            other.begin(self.about)
            with other.connection:
                for row in self.rows():
                    if not self.why_not(row):
                        other._insert(row)
        if len(trouble) > NAMED:
            trouble = [*trouble[:NAMED], f"and {len(trouble) - NAMED} more"]
        return [f"{self.path}: damaged results are computed again ({'; '.join(trouble)})"]

    def close(self) -> None:
        """Close the file."""
        self.connection.close()

    def remove(self) -> None:
        """Delete the file, and what a kill has left of an output half written."""
        with suppress(StoreError):
            delete(self.scratch)
        self.close()
        for ending in ("-journal", "-wal", "-shm", ""):  # the logs are there if a head that was damaged asks for them
            delete(self.path.with_name(self.path.name + ending))


AnyStore = TypeVar("AnyStore", bound=Store)
Maker = Callable[[Path, str], AnyStore]


def _named(row: StoredTile) -> str:
    return f"tile {row.start}"  # where it ends may be damaged, too


def _refuse_others(path: Path) -> None:
    """Refuse what is no file of the program's where its store is to be, or was.

    Raises
    ------
    StoreError
    """
    if (path / "manifest.jsonl").exists():
        former = "is a folder, in which revisions up to a757d98 keep what is finished"
        raise StoreError(f"{path}: {former}; finish it with one of these, or delete the folder to begin anew")
    if os.path.lexists(path) and (path.is_symlink() or not path.is_file()):
        raise StoreError(f"{path}: is no file, where what is finished is kept; move it, or give another output")


@contextmanager
def looked_at(path: Path) -> Iterator[Store]:
    """The store at `path`, to be read only; another process may be at work there.

    Raises
    ------
    StoreError
        If there is something else.
    """
    _refuse_others(path)
    try:
        store = Store(path, "mode=ro")
        try:
            store.is_new()
        except sqlite3.OperationalError:  # a change is half done, which only who writes to it may take back
            store.close()
            store = Store(path, "mode=ro&immutable=1")
        with closing(store):
            if store.is_new():
                raise StoreError(f"{path}: nothing is kept there yet")
            yield store
    except sqlite3.Error as error:
        raise StoreError(f"{path}: cannot be read ({error})") from None


def finished_at(path: Path, configuration: Mapping[str, Any]) -> list[StoredTile]:
    """What is finished at `path`, without the results, if it is of this configuration; raises as `looked_at`."""
    if not path.exists():
        return []
    with looked_at(path) as store:
        return list(store.summaries()) if store.about["configuration"] == as_text(configuration) else []


def holder(path: Path) -> str:
    """Who is at work at the store `path`, or "" if nobody is."""
    if not is_locked(path):
        return ""
    try:
        with looked_at(path) as store:
            return "process {process} on {host}, since {since}".format_map(store.about)
    except (StoreError, KeyError):  # it has not written its name yet
        return "another process"


@contextmanager
def _owned(make: Maker[AnyStore], path: Path) -> Iterator[AnyStore]:
    """The store at `path`, locked against other processes while the context lasts.

    Raises
    ------
    StoreError
        If another process holds it, naming that process, or there is a file of somebody else.
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
        # what has our mark, or is too short for one, may be deleted, damaged or not
        short = len(head) < PLACE_OF_APPLICATION.stop and MAGIC.startswith(head[: len(MAGIC)])
        if not short and head[PLACE_OF_APPLICATION] != APPLICATION.to_bytes(4):
            other = "lacks the mark of dimersweep, where what is finished is kept"
            raise StoreError(f"{path}: {other}; move it, or give another output")
        store = stack.enter_context(closing(make(path, "mode=rwc" if honest else "mode=rwc&nolock=1")))
        store.is_cut = not short and head[PLACE_OF_VERSIONS] != b"\1\1"  # SQLite would not write to it
        yield store


@contextmanager
def opened_store(
    make: Maker[AnyStore], path: Path | None, configuration: Mapping[str, Any], size: int, *, force: bool = False
) -> Iterator[AnyStore]:
    """The store of this configuration, locked against other processes while the context lasts.

    If that ends with an error, and nothing was finished, no file is left behind.

    Parameters
    ----------
    make : callable
        `Store`, or what has the parameters and the verbs of it.
    path : Path, optional
        Without one it is in memory, and nobody else's.
    configuration : mapping
        All that decides the numbers, as JSON can hold it.
    size : int
        Number of points or parts.
    force : bool
        Whether results of another configuration, or a damaged store, may be deleted. Sound ones of this very
        configuration are kept all the same.

    Raises
    ------
    StoreError
        If another process is at work there, what is there belongs to another configuration (with what differs), or
        it cannot be written.
    """
    about = _about(configuration, size)
    if path is None:
        with closing(make(Path(":memory:"), "mode=memory")) as store:
            store.begin(about)
            yield store
        return
    with ExitStack() as stack:
        with disk_errors(f"{path}", "nothing was computed"):
            trouble = _mended(make, path, about, force=force)
            store = stack.enter_context(_owned(make, path))
            for setting in ("writable_schema = OFF", "synchronous = FULL"):
                store.pragma(setting)
            if store.is_new():
                store.begin(about)
                sync(path.parent)  # the new name must outlive a power cut
            store.check_of(about)
            store.trouble = trouble
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
    """Make sure that what is at `path` is whole, and goes with what is asked for; what was damaged, in words."""
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
    """What a new store tells of itself."""
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
