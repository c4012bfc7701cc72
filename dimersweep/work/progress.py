"""How far a sweep is: a live bar on a terminal, a plain line now and then in a log."""

import sys
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from dimersweep.kernel.compiler.cache import is_compiled

LINE_SECONDS = 10.0  # between two plain lines
COMPILE_STEP, COMPILE_TOLD = 10.0, 600.0  # between two lines while the kernel is compiled, and how long at most [s]


class Tally:
    """Counts of finished points, by mode."""

    def __init__(self, total: int, before: Mapping[str, int] | None = None) -> None:
        self.total = total
        self.modes: Counter[str] = Counter(before or {})
        self.before = self.done  # by an earlier process: they say nothing of the speed of this one
        self.start = perf_counter()

    @property
    def done(self) -> int:
        """Number of finished points."""
        return self.modes.total()

    def add(self, modes: Mapping[str, int]) -> None:
        """Count finished points, so many of each mode."""
        self.modes.update(modes)

    def seconds_left(self) -> float:
        """Time until the end at the mean rate so far [s]."""
        return (perf_counter() - self.start) * (self.total - self.done) / max(self.done - self.before, 1)

    def words(self) -> str:
        """Such as ``drift 512, rest 30``, the most frequent first."""
        return ", ".join(f"{mode} {count}" for mode, count in self.modes.most_common())


def clock(seconds: float) -> str:
    """Such as 1:02:03, hours first."""
    minutes, seconds = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{seconds:02d}"


class Silent:
    """Counts and shows nothing; the base of the two that show something."""

    def __init__(self, total: int, before: Mapping[str, int] | None = None) -> None:
        self.tally = Tally(total, before)

    def add(self, modes: Mapping[str, int]) -> None:
        """Take note of finished points, so many of each mode."""
        self.tally.add(modes)

    def expect(self, total: int) -> None:
        """Take note that so many points are to be run in all: of a map that is refined, that shows as it goes."""
        self.tally.total = total


class Lines(Silent):
    """Plain lines on stderr, for logs."""

    def __init__(self, total: int, before: Mapping[str, int] | None = None) -> None:
        super().__init__(total, before)
        self.last = perf_counter()
        if before:
            print(f"going on: {self.tally.done} of {total} points are done", file=sys.stderr, flush=True)

    def add(self, modes: Mapping[str, int]) -> None:
        """Take note, and print a line every `LINE_SECONDS` and at the end."""
        super().add(modes)
        now, tally = perf_counter(), self.tally
        if now - self.last < LINE_SECONDS and tally.done < tally.total:
            return
        self.last = now
        share = f"{tally.done}/{tally.total} points, {100 * tally.done // tally.total} %"
        times = f"elapsed {clock(now - tally.start)}, left {clock(tally.seconds_left())}"
        print(f"{share}, {times}: {tally.words()}", file=sys.stderr, flush=True)


class Bar(Silent):
    """A live bar on a terminal, inside a running `rich` display."""

    def __init__(self, total: int, before: Mapping[str, int] | None, display: Progress) -> None:
        super().__init__(total, before)
        self.display = display
        self.task = display.add_task(self.tally.words(), total=total, completed=self.tally.done)

    def add(self, modes: Mapping[str, int]) -> None:
        """Take note and move the bar."""
        super().add(modes)
        self.display.update(self.task, completed=self.tally.done, description=self.tally.words())

    def expect(self, total: int) -> None:
        """Take note and lengthen the bar."""
        super().expect(total)
        self.display.update(self.task, total=total)


def tell_of_compiling() -> None:
    """Say on stderr that the kernel is about to be compiled, if it is, and go on saying how long that has taken."""
    if not is_compiled():
        print("compiling the kernel: 10 to 60 s, once for each version", file=sys.stderr, flush=True)
        threading.Thread(target=_tell_seconds, daemon=True).start()


def _tell_seconds() -> None:
    from dimersweep.kernel.compiler import keeping

    begun = perf_counter()
    while (seconds := perf_counter() - begun) < COMPILE_TOLD and not keeping.ready.wait(COMPILE_STEP):
        if keeping.under_way.is_set():
            print(f"compiling the kernel: {seconds + COMPILE_STEP:.0f} s so far", file=sys.stderr, flush=True)


@contextmanager
def watch(total: int, *, show: bool, before: Mapping[str, int] | None = None) -> Iterator[Silent]:
    """Follow a sweep of `total` points; what it yields is told of finished points by ``add``.

    Parameters
    ----------
    total : int
    show : bool
        Whether to show anything, on stderr.
    before : mapping of str to int, optional
        Tally of points that an earlier process has finished.
    """
    console = Console(stderr=True)
    if not show:
        yield Silent(total, before)
    elif not console.is_terminal:
        yield Lines(total, before)
    else:
        left = TimeRemainingColumn(elapsed_when_finished=True)
        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("points"), left, TextColumn("{task.description}"))
        with Progress(*columns, console=console) as display:
            yield Bar(total, before, display)
