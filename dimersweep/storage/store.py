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
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote
from uuid import uuid4

from dimersweep.cubes.results import Tile, gaps
from dimersweep.errors import StoreError
from dimersweep.faces import __version__
from dimersweep.kernel.model.layout import CODES, OUT
from dimersweep.storage.files import HALF, delete, disk_errors, replacing, sync
from dimersweep.storage.locking import Lock, is_locked, lock_of
from dimersweep.storage.provenance import as_text, configured, cpu, differences, digest

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
    results : bytes
    """

    start: int
    stop: int
    what: str
    seconds: float
    wall: float
    at: str
    sha256: str = ""
    results: bytes = b""


Check = Callable[[StoredTile], str]  # why the results of a row, whose checksum holds, must not be used; "" if they may


def _connected(path: Path, how: str) -> sqlite3.Connection:
    place = f"file:{quote(os.fsencode(path.absolute()))}?{how}"
    connection = sqlite3.connect(place, timeout=BUSY_SECONDS, isolation_level=None, uri=True)
    connection.text_factory = lambda text: text.decode(errors="replace")  # what is damaged is found by its checksum
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA writable_schema = ON")  # lets a file be read from which the end was cut
    return connection


class Store:
    """A store that is open, see `looked_at` and `opened_store`.

    Parameters
    ----------
    path : Path
    how : str
        How it is opened, as in the address of an SQLite file.
    """

    def __init__(self, path: Path, how: str) -> None:
        self.path = path
        self.is_cut = False  # whether some rows could not be read
        self.trouble: list[str] = []  # what was damaged when it was opened, in words
        self._connection = _connected(path, how)

    @cached_property
    def about(self) -> dict[str, Any]:
        """What it is of.

        Raises
        ------
        StoreError
            If that cannot be read, or was written by another version of the format.
        """
        try:
            schema = [sql for (sql,) in self._connection.execute("SELECT sql FROM sqlite_master WHERE sql NOT NULL")]
            about = dict(self._connection.execute("SELECT name, value FROM about"))
            sound = digest(about["configuration"]) == about["configuration_sha256"]
            sound = sound and type(about["points"]) is int and type(about["wanted"]) is int
            sound = sound and bool(HALF.fullmatch(about["scratch"]))  # nothing else is ever deleted
            about["configuration"] = json.loads(about["configuration"])
            sound = sound and isinstance(about["configuration"], dict) and 0 < about["wanted"] <= about["points"]
        except (sqlite3.Error, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            sound = False
        if not sound:
            why = "is damaged, or no store of this version of dimersweep; begin anew (force=True)"
            raise StoreError(f"{self.path}: {why}")
        if tuple(schema) != SCHEMA or (about.get("format"), about.get("layout")) != (FORMAT, LAYOUT):
            raise StoreError(f"{self.path}: has the format of another version of dimersweep; begin anew (force=True)")
        return about

    @property
    def configuration(self) -> dict[str, Any]:
        """All that decides the numbers."""
        configuration: dict[str, Any] = self.about["configuration"]
        return configuration

    @property
    def size(self) -> int:
        """Number of points or parts."""
        return int(self.about["points"])

    @property
    def scratch(self) -> Path:
        """Where the output is written before it takes its name: the next process deletes what a kill has left there."""
        return self.path.with_name(self.about["scratch"])

    def rows(self, columns: str = "*") -> Iterator[StoredTile]:
        """All rows, without the columns that are not named; of a damaged file those that can be read, from both ends."""
        reached = -1
        try:
            for row in self._connection.execute(f"SELECT {columns} FROM tiles ORDER BY start"):
                reached = row[0]
                yield StoredTile(*row)
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):  # of the disk, not of what is on it
                raise
            self.is_cut = True
            with suppress(sqlite3.DatabaseError):
                beyond = f"SELECT {columns} FROM tiles WHERE start > ? ORDER BY start DESC"
                yield from (StoredTile(*row) for row in self._connection.execute(beyond, (reached,)))

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
        found = self._connection.execute(
            f"SELECT * FROM tiles WHERE start >= {before} AND start < ? AND stop > ? ORDER BY start",
            (start, stop, start),
        )
        try:
            for row in map(StoredTile._make, found):
                if why := self._why_not(row):
                    raise StoreError(f"{self.path}: {_named(row)} {why}; run the same again")
                yield row
        except sqlite3.DatabaseError as error:
            raise StoreError(f"{self.path}: cannot be read ({error}); run the same again") from None

    @contextmanager
    def writing(self) -> Iterator[None]:
        """What is changed in this context is on the disk at its end, or nothing of it is.

        Raises
        ------
        sqlite3.Error
            If the disk refuses.
        """
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            with suppress(sqlite3.Error):
                self._connection.execute("ROLLBACK")
            raise

    def put(
        self, tile: Tile, what: str, results: bytes | memoryview, *, seconds: float = 0.0, wall: float = 0.0
    ) -> None:
        """Add a row, within `writing`."""
        row = StoredTile(*tile, what, seconds, wall, datetime.now(UTC).isoformat(timespec="seconds"))
        self._insert(row._replace(sha256=self._checksum(row, results), results=results))  # type: ignore[arg-type]

    def _insert(self, row: StoredTile) -> None:
        self._connection.execute("INSERT INTO tiles VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)

    def take_out(self, start: int) -> None:
        """Remove the row that begins at a point, within `writing`."""
        self._connection.execute("DELETE FROM tiles WHERE start = ?", (start,))

    def tell(self, **about: str | int) -> None:
        """Change what is written of the store, within `writing`."""
        self._connection.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", about.items())
        self.about.update(about)

    def _checksum(self, row: StoredTile, results: bytes | memoryview) -> str:
        sha256 = hashlib.sha256(json.dumps([self.about["configuration_sha256"], *row[:6]]).encode())
        sha256.update(results)
        return sha256.hexdigest()

    def _why_not(self, row: StoredTile, check: Check = lambda row: "") -> str:
        """Why a row must not be used; "" if it may."""
        try:
            if self._checksum(row, row.results) != row.sha256:
                return "has other bytes than were written"
            sound = 0 <= row.start < row.stop <= self.size and row.seconds + row.wall >= 0
            return check(row) if sound else "is not of this grid"
        except TypeError:  # of a column that holds what it cannot
            return "has other bytes than were written"

    def is_empty(self) -> bool:
        """Whether nothing is finished."""
        return next(self.summaries(), None) is None

    def is_new(self) -> bool:
        """Whether nothing was ever written there."""
        try:
            return bool(self._connection.execute("PRAGMA page_count").fetchone() == (0,))
        except sqlite3.OperationalError:
            raise
        except sqlite3.DatabaseError:  # it is damaged, and so it was
            return False

    def begin(self, about: Mapping[str, Any]) -> None:
        """Make the tables of a new store.

        Raises
        ------
        sqlite3.Error, OSError
            If the disk refuses.
        """
        self._connection.execute("PRAGMA synchronous = FULL")
        with self.writing():
            self._connection.execute(f"PRAGMA application_id = {APPLICATION}")
            for statement in SCHEMA:
                self._connection.execute(statement)
            self._connection.executemany("INSERT INTO about VALUES (?, ?)", about.items())

    def go_on(self, lock: Lock, check: Check) -> None:
        """Make sure that what was left behind is whole: what is damaged is noted in `trouble`, and the rest written anew."""
        delete(self.scratch)
        trouble = [f"{_named(row)} {why}" for row in self.rows() if (why := self._why_not(row, check))]
        if self.is_cut or not self._is_whole(lock):
            trouble.append("parts of the file cannot be read")
        if len(trouble) > NAMED:
            trouble = [*trouble[:NAMED], f"and {len(trouble) - NAMED} more"]
        if trouble:
            self.trouble = [f"{self.path}: damaged results are computed again ({'; '.join(trouble)})"]
            self._rewrite(lock, check)
        self._connection.execute("PRAGMA writable_schema = OFF")
        self._connection.execute("PRAGMA synchronous = FULL")

    def _is_whole(self, lock: Lock) -> bool:
        """Whether SQLite finds nothing wrong with its pages, and may write to it."""
        try:
            found = self._connection.execute("PRAGMA quick_check(1)").fetchone()
        except sqlite3.OperationalError:
            raise
        except sqlite3.DatabaseError:
            return False
        return found == ("ok",) and lock.head()[PLACE_OF_VERSIONS] == b"\1\1"

    def _rewrite(self, lock: Lock, check: Check) -> None:
        """Put a file with the rows that are whole in place of this one."""
        about = self.about | {"configuration": as_text(self.configuration)}
        with replacing(self.path, self.scratch) as scratch:
            other = Store(scratch, _how(lock))
            other.begin(about)
            with other.writing():
                for row in self.rows():
                    if not self._why_not(row, check):
                        other._insert(row)
            other.close()
            self.close()
            following = Lock(scratch)
        lock.become(following)
        self._connection = _connected(self.path, _how(lock))

    def clear(self, lock: Lock) -> None:
        """Leave an empty file."""
        with suppress(StoreError):
            delete(self.scratch)
        self.close()
        for ending in ("-journal", "-wal", "-shm"):  # the last two are there if a head that was damaged asks for them
            delete(self.path.with_name(self.path.name + ending))
        lock.empty()
        self.__dict__.pop("about", None)
        self._connection = _connected(self.path, _how(lock))

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def remove(self) -> None:
        """Delete the file, and what a kill has left of an output half written."""
        self.close()
        delete(self.scratch)
        self.path.unlink(missing_ok=True)


def _named(row: StoredTile) -> str:
    return f"tile {row.start}"  # where it ends may be damaged, too


def _how(lock: Lock) -> str:
    return "mode=rwc" if lock.honest else "mode=rwc&nolock=1"


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
        except (
            sqlite3.OperationalError
        ):  # a kill has left a change half done, which only who writes to it may take back
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
        return list(store.summaries()) if as_text(store.configuration) == as_text(configuration) else []


@contextmanager
def _locked(path: Path) -> Iterator[Lock]:
    """The lock of the store at `path`.

    Raises
    ------
    StoreError
        If another process holds it, naming that process, or there is a file of somebody else.
    """
    _refuse_others(path)
    try:
        lock = lock_of(path)
    except BlockingIOError:
        raise StoreError(f"{path}: a sweep is at work here ({holder(path)}); wait for it or stop it first") from None
    try:
        head = lock.head()  # what has our mark, or is too short for one, may be deleted, damaged or not
        short = len(head) < PLACE_OF_APPLICATION.stop and MAGIC.startswith(head[: len(MAGIC)])
        if not short and head[PLACE_OF_APPLICATION] != APPLICATION.to_bytes(4):
            other = "lacks the mark of dimersweep, where what is finished is kept"
            raise StoreError(f"{path}: {other}; move it, or give another output")
        yield lock
    finally:
        lock.close()


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
def opened_store(
    path: Path | None,
    configuration: Mapping[str, Any],
    size: int,
    check: Check = lambda row: "",
    *,
    force: bool = False,
) -> Iterator[Store]:
    """The store of this configuration, locked against other processes while the context lasts.

    If that ends with an error, and nothing was finished, no file is left behind.

    Parameters
    ----------
    path : Path, optional
        Without one it is in memory, and nobody else's.
    configuration : mapping
        All that decides the numbers, as JSON can hold it.
    size : int
        Number of points or parts.
    check : callable
        Why the results of a row, whose checksum holds, must not be used; "" if they may.
    force : bool
        Whether results of another configuration, or a damaged store, may be deleted. Sound ones of this very
        configuration are kept all the same.

    Raises
    ------
    StoreError
        If another process is at work there, what is there belongs to another configuration (with what differs), or
        it cannot be written.
    """
    if path is None:
        with closing(Store(Path(":memory:"), "mode=memory")) as store:
            store.begin(_about(configuration, size))
            yield store
        return
    with ExitStack() as stack:
        with disk_errors(f"{path}", "nothing was computed"):
            lock = stack.enter_context(_locked(path))
            store = Store(path, _how(lock))
            stack.callback(store.close)
            try:
                _take_up(store, lock, configuration, size, check)
            except StoreError:
                if not force:
                    raise
                store.clear(lock)
                _take_up(store, lock, configuration, size, check)
        try:
            yield store
        except BaseException:
            with suppress(OSError, sqlite3.Error):
                if store.is_empty():
                    store.remove()
            raise


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


def _take_up(store: Store, lock: Lock, configuration: Mapping[str, Any], size: int, check: Check) -> None:
    """Begin a store, or go on with the one that is there if it goes with a configuration."""
    if store.is_new():
        store.begin(_about(configuration, size))
        sync(store.path.parent)  # the new name must outlive a power cut
    if as_text(store.configuration) != as_text(configuration):
        changes = "".join(f"\n  {line}" for line in differences(store.configuration, configuration))
        raise StoreError(
            f"{store.path}: holds results of other settings, stopped before the end; "
            f"begin anew with force=True, or give another output. What differs:{changes}"
        )
    if store.size != size:
        why = f"tells of {store.size} points, where its grid has {size}"
        raise StoreError(f"{store.path}: is damaged ({why}); begin anew (force=True)")
    store.go_on(lock, check)
    with store.writing():
        store.tell(process=os.getpid(), host=socket.gethostname(), since=time.strftime("%Y-%m-%d %H:%M:%S"))
