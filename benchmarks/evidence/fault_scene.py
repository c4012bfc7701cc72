"""The scene of an attack of ``faults.py``: a folder with a small sweep, the processes that run it, and the list of attacks."""

import hashlib
import os
import random
import shutil
import signal
import sqlite3
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

TOML = """[sweep]
title = "a sweep to be attacked"
periods = 60
output = "{out}"
[grid]
f = [15, 20, 25]
beta0 = {{ start = 3, stop = 87, num = 40, unit = "deg" }}
[fixed]
xdot0 = 1
"""
SEARCH = '[search]\nover = "beta0"\n'
BESIDE = ("-journal", "-wal", "-shm")  # endings of SQLite's files
HALVES = 3  # sweeps of a kind that are killed half way, to be copied
LONGEST = 120.0  # seconds that a sweep may take before it counts as hanging


def forked(call: Callable[[], Any], told: Path) -> int:
    """Process number of a child that makes `call`, with what it prints in the file `told`; this process has no threads."""
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        handle = os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(handle, 1)
        os.dup2(handle, 2)
        call()
        code = 0
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def ended(pid: int, longest: float = LONGEST) -> int:
    """Exit status of a child, negative for a signal.

    Raises
    ------
    Hanging
        If it takes too long; it is killed.
    """
    ends = time.monotonic() + longest
    while time.monotonic() < ends:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    raise Hanging(f"took longer than {longest:g} s")


class Hanging(Exception):
    """A process that does not end."""


class Skipped(Exception):
    """An attack that cannot be made here."""


class Stock:
    """Sweeps that were killed and finished cubes, by what was declared: attacks begin with copies of them."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.number = folder, 0
        self.halves: dict[str, list[Path]] = {}
        self.wholes: dict[str, Path] = {}

    def place(self) -> Path:
        """A new path in the folder."""
        self.number += 1
        return self.folder / str(self.number)


@dataclass
class Scene:
    """A folder with a sweep to be attacked, and things of the user's that must stay as they are."""

    folder: Path
    rng: random.Random
    stock: Stock
    out: str = "cube.nc"
    reference: str = "sweep"  # which undisturbed cube the outcome is compared with
    length: float = 1.0  # of the sweep [s]
    kills: int = 0
    hostile: bool = False  # what is asked for must be refused
    again: tuple[str, ...] = ()  # options of the call after the attack
    precious: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        (self.folder / "mine").mkdir()
        (self.folder / "mine" / "notes.txt").write_text("precious")
        (self.folder / "cube.nc.bak").write_text("precious")
        self.declare()
        self.precious = self.snapshot()

    @property
    def cube(self) -> Path:
        """The output."""
        return self.folder / self.out

    @property
    def tiles(self) -> Path:
        """The store of its finished points."""
        return self.folder / f"{self.out}.tiles"

    def beside(self, ending: str) -> Path:
        """A file of SQLite's beside the store."""
        return self.folder / f"{self.out}.tiles{ending}"

    @property
    def text(self) -> str:
        """What is declared."""
        return (self.folder / "sweep.toml").read_text()

    def declare(self, text: str | None = None) -> None:
        """Write what is to be swept."""
        (self.folder / "sweep.toml").write_text(TOML.format(out=self.out) if text is None else text)

    def snapshot(self) -> dict[str, str]:
        """What lies beside the output, with a digest of each file."""
        own = (self.out, *(f"{self.out}.tiles{more}" for more in ("", *BESIDE)), "sweep.toml", "told", "told before")
        return {
            str(path.relative_to(self.folder)): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
            for path in sorted(self.folder.rglob("*"))
            if path.relative_to(self.folder).parts[0] not in own
        }

    def start(self, *more: str, before: Callable[[], None] = lambda: None, told: str = "told") -> int:
        """A child that runs the sweep, after `before`, and prints into the file `told`."""

        def call() -> None:
            from dimersweep.cli import main

            os.chdir(self.folder)
            before()
            sys.argv = ["dimersweep", "run", "sweep.toml", "--no-plot", "--workers", "2", *more]
            main()

        return forked(call, self.folder / told)

    def run(self, *more: str, before: Callable[[], None] = lambda: None) -> int:
        """Run the sweep to its end; its exit status."""
        return ended(self.start(*more, before=before))

    def kill(self, pid: int) -> None:
        """Kill a sweep, if it has not ended by itself."""
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            self.kills += 1

    def came_through(self, pid: int, told: str = "told") -> str | None:
        """Wait for a sweep that is under attack: it must make the cube, or say in one line why not; "FAILED: how" if not."""
        code = ended(pid)
        told = self.told(told)
        if (code == 0 and self.cube.exists()) or (code and line_of(told)):
            return None
        return f"FAILED: under attack: exit {code}: {told.strip()[-300:]}"

    def told(self, name: str = "told") -> str:
        """What the last child printed, into that file."""
        return (self.folder / name).read_text(errors="replace")

    def begin(self) -> None:
        """Leave a sweep behind that was killed after some of its points: one of a few that were."""
        known = self.stock.halves.setdefault(self.text, [])
        if len(known) == HALVES:
            shutil.copy(self.rng.choice(known), self.tiles)
            return
        pid, tiles = self.start(before=slowed), self.rng.randrange(2, 9)
        ends = time.monotonic() + LONGEST
        while self._tiles() < tiles and time.monotonic() < ends:
            time.sleep(0.002)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        with closing(sqlite3.connect(self.tiles)) as file:  # takes back what was half done
            file.execute("SELECT count(*) FROM tiles").fetchone()
        known.append(Path(shutil.copy(self.tiles, self.stock.place())))

    def _tiles(self) -> int:
        with suppress(sqlite3.Error), closing(sqlite3.connect(f"file:{self.tiles}?mode=ro", uri=True)) as file:
            return int(file.execute("SELECT count(*) FROM tiles").fetchone()[0])
        return 0

    def complete(self) -> None:
        """Leave a finished cube behind."""
        whole = self.stock.wholes.get(self.text)
        if whole is None:
            self.run()
            place = self.stock.wholes[self.text] = self.stock.place()
            (shutil.copytree if self.cube.is_dir() else shutil.copy)(self.cube, place)
        else:
            (shutil.copytree if whole.is_dir() else shutil.copy)(whole, self.cube)


def slowed() -> None:
    """Have this process take its time for each point, and write every tile by itself."""
    import dimersweep.storage.tilestore as store
    import dimersweep.work.tiles as there
    from dimersweep.runs import solving

    store.FLUSH_SECONDS, store.DISK_SHARE, run_many = 0.0, 1e9, solving.run_many

    def slow(*arguments: Any, **more: Any) -> int:
        made: int = run_many(*arguments, **more)
        time.sleep(0.005 * made)
        return made

    solving.run_many = slow
    there.CHUNK_SECONDS = there.TILE_SECONDS = 0.02


def line_of(told: str) -> str:
    """The one line with which a command has refused; "" if it has not, or not in one line."""
    lines = [line for line in told.splitlines() if line.startswith("dimersweep: error: ")]
    return lines[0] if len(lines) == 1 and "Traceback" not in told else ""


ATTACKS: dict[str, Callable[[Scene], str | None]] = {}


def attack(name: str) -> Callable[[Callable[[Scene], str | None]], Callable[[Scene], str | None]]:
    """Enter a function into the list."""

    def enter(function: Callable[[Scene], str | None]) -> Callable[[Scene], str | None]:
        ATTACKS[name] = function
        return function

    return enter
