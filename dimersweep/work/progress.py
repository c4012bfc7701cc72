"""Show the progress of a sweep or a fit: a live bar in a notebook or on a terminal, lines of text in a log."""

import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from html import escape
from importlib import import_module
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Column

from dimersweep.kernel.compiler.pipelines import FAST, PLAIN, is_compiled, pipeline

# time between two lines of text, and between two updates of the bar in a notebook
LINE_SECONDS, BAR_SECONDS = 10.0, 0.2
ENOUGH_SECONDS = 2.0  # work of each worker before the time left is shown: the first points may be of any kind
COMPILE_TIMES = {FAST: "10 to 60 s", PLAIN: "1 to 4 minutes"}
# time between two lines while the kernel is compiled, and of the last one [s]
COMPILE_STEP, COMPILE_SHOWN = 10.0, 600.0


class Tally:
    """Numbers of finished points, by mode, and the time that they took.

    Parameters
    ----------
    total : int
        Number of points to be run in all.
    before : mapping of str to int, optional
        Numbers of points that an earlier process has finished, by mode.
    workers : callable
        Returns the number of workers, which may come and go.
    show : callable
        Called with this tally after each change.
    """

    def __init__(
        self,
        total: int,
        before: Mapping[str, int] | None = None,
        workers: Callable[[], int] = lambda: 1,
        show: "Callable[[Tally], None]" = lambda tally: None,
    ) -> None:
        self.total, self.workers, self.show = total, workers, show
        self.doing = ""  # present activity in words, shown in place of the modes
        self.modes: Counter[str] = Counter(before or {})
        # number of tasks; points and time of all tasks but the first one of each worker
        self.tasks, self.timed, self.seconds = 0, 0, 0.0
        self.start = perf_counter()

    @property
    def done(self) -> int:
        """Number of finished points."""
        return self.modes.total()

    def add(self, modes: Mapping[str, int], seconds: float = 0.0) -> None:
        """Count the finished points of a task by mode, and the time that they took [s]; 0 if they were not run."""
        self.modes.update(modes)
        if seconds:
            self.tasks += 1
        if seconds and self.tasks > self.workers():
            self.timed, self.seconds = self.timed + sum(modes.values()), self.seconds + seconds
        self.show(self)

    def expect(self, total: int) -> None:
        """Set the number of points to be run in all, which becomes known step by step for a refined map."""
        self.total = total
        self.show(self)

    def tell(self, doing: str) -> None:
        """Show the present activity in words."""
        self.doing = doing
        self.show(self)

    @property
    def elapsed(self) -> str:
        """Time since the start."""
        return clock(perf_counter() - self.start)

    def time_left(self) -> str:
        """Return the expected time until the end, from the mean time of a point; "-:--:--" while it is unknown.

        The first task of each worker does not count, as it may load or compile what later tasks find done. The time is
        unknown until each worker has worked for `ENOUGH_SECONDS`, as the first points may be of any kind.
        """
        left, workers = self.total - self.done, max(1, self.workers())
        if left and self.seconds < ENOUGH_SECONDS * workers:
            return "-:--:--"
        return clock(left * self.seconds / max(1, self.timed) / workers)

    def words(self) -> str:
        """Return the present activity, or counts such as ``drift 512, rest 30``, the most frequent first."""
        return self.doing or ", ".join(f"{mode} {count}" for mode, count in self.modes.most_common())


def clock(seconds: float) -> str:
    """Return a time in hours, minutes and seconds, such as 1:02:03."""
    minutes, seconds = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{seconds:02d}"


def in_lines(
    write: Callable[[str, Tally], None] = lambda line, _: print(line, file=sys.stderr, flush=True),
    seconds: float = LINE_SECONDS,
) -> Callable[[Tally], None]:
    """Return a function that shows a `Tally` in a line, at most once in `seconds`, and at the end.

    By default lines are printed on stderr, for logs.
    """
    last = perf_counter()

    def show(tally: Tally) -> None:
        nonlocal last
        now = perf_counter()
        if now - last < seconds and tally.done < tally.total:
            return
        last = now
        share = f"{tally.done}/{tally.total} points, {100 * tally.done // tally.total} %"
        write(f"{share}, elapsed {tally.elapsed}, left {tally.time_left()}: {tally.words()}", tally)

    return show


def notebook_bar() -> Callable[[Tally], None] | None:
    """Return a function that shows a `Tally` as a bar in the notebook of this process; None without a notebook."""
    ipython = sys.modules.get("IPython")  # every kernel of a notebook has imported it
    if not hasattr(ipython and ipython.get_ipython(), "kernel"):
        return None
    shows = import_module("IPython.display")

    shown = shows.display(shows.HTML("<progress value=0></progress>"), display_id=True)

    def write(line: str, tally: Tally) -> None:
        shown.update(shows.HTML(f'<progress value="{tally.done}" max="{tally.total}"></progress> {escape(line)}'))

    return in_lines(write, BAR_SECONDS)


def report_compiling() -> None:
    """Print on stderr that the kernel is compiled, if it has to be, and now and then how long that has taken."""
    if not is_compiled():
        print(f"compiling the kernel: {COMPILE_TIMES[pipeline()]}, once for each version", file=sys.stderr, flush=True)
        threading.Thread(target=_report_seconds, daemon=True).start()


def _report_seconds() -> None:
    """Print now and then for how long the kernel is being compiled, until it is ready."""
    from dimersweep.kernel.compiler import cache

    begun = perf_counter()
    while (seconds := perf_counter() - begun) < COMPILE_SHOWN and not cache.ready.wait(COMPILE_STEP):
        if cache.under_way.is_set():
            print(f"compiling the kernel: {seconds + COMPILE_STEP:.0f} s so far", file=sys.stderr, flush=True)


@contextmanager
def watch(total: int, before: Mapping[str, int], workers: Callable[[], int], *, show: bool) -> Iterator[Tally]:
    """Yield a `Tally`; with `show`, display it: as a bar in a notebook or on a terminal, as lines in a log (stderr)."""
    console = Console(stderr=True)
    if not show:
        yield Tally(total, before, workers)
        return
    bar = notebook_bar()
    if bar or not console.is_terminal:
        if done := sum(before.values()):
            print(f"going on: {done} of {total} points are done", file=sys.stderr, flush=True)
        yield Tally(total, before, workers, bar or in_lines())
        return
    left = TextColumn("{task.fields[left]}", style="progress.remaining")
    # the bar and the words share what the numbers leave of the width
    bar_column = BarColumn(bar_width=None, table_column=Column(ratio=1))
    words = TextColumn("{task.description}", table_column=Column(ratio=2, no_wrap=True))
    columns = (bar_column, MofNCompleteColumn(), TextColumn("points"), left, words)
    with Progress(*columns, console=console, expand=True) as display:
        task = display.add_task("", total=total, left="")

        def move(tally: Tally) -> None:
            """Move the bar; show the time so far at the end, or where no time left is known."""
            time = tally.elapsed if tally.doing or tally.done >= tally.total else tally.time_left()
            display.update(task, total=tally.total, completed=tally.done, description=tally.words(), left=time)

        tally = Tally(total, before, workers, move)
        move(tally)
        yield tally
