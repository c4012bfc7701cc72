"""What every shortcut of the kernel buys and what it changes: ``python benchmarks/speed/shortcuts.py [--small] [--runs]``.

Each shortcut is taken out of a copy of the package. The copies are compiled first, several at a time. Then the package and
each copy run the same scenes in turn: the time of a run to its verdict, and the error of the states over four forcing periods
against a run at a far tighter setting. The table goes to the terminal and to docs/shortcuts.md. Most of the time goes into
compiling: some minutes in all on two quiet cores. ``--runs`` measures on what people run (`workload`) in place of the scenes,
``--together`` takes all that ``--only`` names out of one copy.
"""

import argparse
import ast
import json
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from compare import Worker, git, on_one_core
from speed import ROOT, SCENES

from dimersweep.kernel.compiler.cache import base_folders

DOCUMENT = ROOT / "docs" / "shortcuts.md"
KEPT = base_folders()[0].parent  # where the compiled code of the kernel as it is lies
RTOL, FINEST = 1e-8, 1e-13
PERIODS, SHORT = 100, 4  # forcing periods of a run to its verdict, and of one whose states are compared
ROUNDS = 7  # timings of each run
ALLOWED = 10.0  # error with a shortcut, over the larger of rtol and the error without, from which it changes the answer

Edit = Callable[[str], str]


def replaced(old: str, new: str) -> Edit:
    """An edit of a text that occurs once.

    Raises
    ------
    ValueError
        When the edit is made and the text is not there, or is there more often.
    """

    def edit(source: str) -> str:
        if source.count(old) != 1:
            raise ValueError(f"{old!r} occurs {source.count(old)} times, not once")
        return source.replace(old, new)

    return edit


def constant(name: str, value: str) -> Edit:
    """An edit that gives a module's constant another value."""

    def edit(source: str) -> str:
        edited, n = re.subn(rf"^{name} = [^#\n]*", f"{name} = {value}  ", source, flags=re.MULTILINE)
        if n != 1:
            raise ValueError(f"{name} is set {n} times, not once")
        return edited

    return edit


def body(function: str, code: str) -> Edit:
    """An edit that gives a function another body."""

    def edit(source: str) -> str:
        found = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef) and node.name == function]
        if len(found) != 1:
            raise ValueError(f"{function} is defined {len(found)} times, not once")
        lines = source.splitlines(keepends=True)
        first, last = found[0].body[0].lineno, found[0].end_lineno
        lines[first - 1 : last] = [f"    {line}\n" for line in code.splitlines()]
        return "".join(lines)

    return edit


def in_turn(*edits: Edit) -> Edit:
    """Edits of one module, one after the other."""

    def edit(source: str) -> str:
        for one in edits:
            source = one(source)
        return source

    return edit


class Shortcut(NamedTuple):
    """One thing the kernel skips.

    Attributes
    ----------
    name : str
    without : str
        What is done in its place.
    edits : dict of str to Edit
        How each module of the kernel reads without it.
    asked : dict
        What a run is asked for in addition, where leaving it out is the shortcut.
    """

    name: str
    without: str
    edits: dict[str, Edit] = {}  # noqa: RUF012 (never modified)
    asked: dict[str, bool] = {}  # noqa: RUF012


SCAN = """
t, step = 0.0, 1e-13 * until
gap, rate, second, third = gap_series(fl, sign, 0.0)
if gap <= 0.0 and rate <= 0.0 and second <= 0.0:
    return 0.0, 1
for probe in range(2, MAX_LANDING_PROBES):
    new = min(t + step, until)
    gap, rate, second, third = gap_series(fl, sign, new)
    if gap <= 0.0:
        low, high = t, new
        while high - low > 4.0 * EPS * high:
            mid = 0.5 * (low + high)
            gap, rate, second, third = gap_series(fl, sign, mid)
            low, high = (mid, high) if gap > 0.0 else (low, mid)
        return high, probe
    if new >= until:
        return inf, probe
    t, step = new, min(0.02 * new, 2e-3 * until)
return t, MAX_LANDING_PROBES
""".strip()

SHORTCUTS = (
    Shortcut(
        "chatter summed to its end",
        "hops down to round-off",
        {"chatter": in_turn(constant("CLOSE_COST", "1e-25"), constant("SPREAD", "0.0"))},
    ),
    Shortcut(
        "impacts slipping straight in closed form",
        "the expansion",
        {"impact/single_impact": body("is_invariant", "return False")},
    ),
    Shortcut(
        "(safeguard) impacts without friction in closed form",
        "the expansion",
        {
            "impact/single_impact": replaced(
                "law.mu == 0.0 and (v > tol or not holds_axially(law.mu_s, law.na, law.aa))", "False"
            )
        },
    ),
    Shortcut(
        "expansion only as far as the leg goes",
        "to the highest order",
        {"impact/expansion": replaced("if 0.0 < end < inf and term", "if end < 0.0 and term")},
    ),
    Shortcut(
        "slip that dies out summed in closed form",
        "the expansion",
        {"impact/single_impact": body("run_down", "return inf, inf")},
    ),
    Shortcut(
        "fewer digits for slow impacts",
        "the same relative accuracy for all",
        {"event_loop": replaced("tol * max(1.0, min(dm.v_scale, fastest) / V)", "tol")},
    ),
    Shortcut(
        "clock in which a double impact is regular",
        "the plain clock",
        {"impact/double_leg": body("ruling_clock", "return PLAIN")},
    ),
    Shortcut(
        "explicit steps over a slip that is slow for a moment",
        "implicit steps at once",
        {"impact/double_leg": constant("LASTS", "0")},
    ),
    Shortcut(
        "(safeguard) implicit steps where a slip stays slow",
        "explicit steps always",
        {"impact/double_leg": constant("LASTS", "MAX_LEG_STEPS")},
    ),
    Shortcut(
        "plain method of a contact phase",
        "rescaled or implicit",
        {
            "contact/phase": body(
                "method_for",
                "if gamma == 0.0 or v == inf:\n    return PLAIN\n"
                "return RESCALED if rate < -FALLING * gamma else IMPLICIT",
            )
        },
    ),
    Shortcut(
        "rescaled method for a slip on its way to rest",
        "implicit",
        {"contact/phase": body("method_for", "return PLAIN if v >= STIFF * dm.T * gamma else IMPLICIT")},
    ),
    Shortcut(
        "implicit method for a slip that stays slow",
        "rescaled",
        {"contact/phase": body("method_for", "return PLAIN if v >= STIFF * dm.T * gamma else RESCALED")},
    ),
    Shortcut(
        "straight line over the last of a slip",
        "steps to its end",
        {"contact/events": body("slip_about_to_end", "return -1")},
    ),
    Shortcut(
        "first guess of an event on a cubic, in contact",
        "bracketing",
        {"contact/location": replaced("if method != RESCALED:\n        guess", "if method < 0:\n        guess")},
    ),
    Shortcut(
        "step that ends at a landing in sight",
        "a step of any length",
        {"contact/phase": body("landing_in_sight", "return inf")},
    ),
    Shortcut(
        "steps to a landing by bounds", "a fine scan, and bisection", {"flight/landing": body("first_landing", SCAN)}
    ),
    Shortcut(
        "Newton's rule to a landing where the gap certainly falls",
        "steps by bounds to the end",
        {"flight/landing": body("fall", "return inf, inf")},
    ),
    Shortcut(
        "second end watched until the first one lands",
        "until the end of the period",
        {
            "flight/landing": replaced(
                "first_landing(fl, 1 - near, min(t, until))", "first_landing(fl, 1 - near, until)"
            )
        },
    ),
    Shortcut(
        "(safeguard) turns of a rod high above the plate stepped over",
        "steps by bounds of the gap alone",
        {"flight/landing": constant("SWIFT", "1e300")},
    ),
    Shortcut(
        "(safeguard) axial onset of slip tried first in planar motion",
        "all directions",
        {"contact/slip_onset": replaced("if hold_b == 0.0:", "if hold_b != hold_b:")},
    ),
    Shortcut(
        "rest known to be for good",
        "waiting until it repeats",
        {"smooth_motion": body("rests_for_good", "return False")},
    ),
    Shortcut("stop when settled", "all periods", asked={"settle": False}),
    Shortcut(
        "neighbouring run only where nothing repeats",
        "for every run",
        {"batch": replaced("codes[k, CODE_MODE] == M_UNRESOLVED and ask.periods", "ask.periods")},
    ),
    Shortcut("no path unless asked", "x1, y1 and gamma too", asked={"path": True}),
    Shortcut("no record unless asked", "events and segments too", asked={"record": True}),
    Shortcut(
        "(safeguard) dips below zero within a step",
        "not looked for",
        {"contact/location": body("hidden_dip", "return 1.0")},
    ),
)


def without(shortcut: Shortcut, folder: Path) -> Path:
    """A copy of the package in `folder` without the shortcut; returns the folder."""
    package = ROOT / "dimersweep"
    shutil.copytree(package, folder / "dimersweep", ignore=shutil.ignore_patterns("__pycache__"))
    for module, edit in shortcut.edits.items():
        path = folder / "dimersweep" / "kernel" / f"{module}.py"
        path.write_text(edit(path.read_text()))
    return folder


def measure(
    scene: dict[str, float], rtol: float, settle: bool = True, path: bool = False, record: bool = False
) -> dict:
    """States at the ends of the first periods, in their scales; processor time of a run to its verdict, and the verdict."""
    from dimersweep.cubes.cube import blank
    from dimersweep.kernel import batch
    from dimersweep.kernel.course import new_workspace
    from dimersweep.kernel.model import layout
    from dimersweep.kernel.record import new_record, no_record
    from dimersweep.parameters import Parameters

    row = Parameters(**scene).row()[None]
    scale = np.ones(layout.N_STATE)
    scale[[layout.D1, layout.D2]], scale[layout.SPIN] = 0.01, 100.0
    scale[[layout.N1, layout.N2, layout.CA, layout.CB]] = 0.1
    space, (out, codes) = new_workspace(), blank(1)
    kept = new_record(300 * PERIODS) if record else no_record()

    def run(periods: int, settle: bool) -> None:
        batch.run_rows(
            row, np.zeros((0, batch.N_START)), batch.ask_for(periods, rtol, settle, path), 0, out, codes, space, kept
        )

    states = []
    for periods in range(1, SHORT + 1):
        run(periods, False)
        states.append((space.state / scale)[: layout.THETA + 1].tolist())
    begun = thread_time()
    run(PERIODS, settle)
    seconds = thread_time() - begun
    mode, status = layout.MODES[codes[0, layout.CODE_MODE]], layout.STATUSES[codes[0, layout.CODE_STATUS]]
    return {"states": states, "seconds": seconds, "mode": mode if status == "ok" else f"failed: {status}"}


def measure_runs(runs: list[dict]) -> dict:
    """Processor time of runs to their verdicts, with the status, mode and number of events of each."""
    from dimersweep.cubes.cube import blank
    from dimersweep.kernel.batch import run_many
    from dimersweep.kernel.model.layout import CODE_MODE, CODE_N_EVENTS, CODE_STATUS

    seconds, told = 0.0, []
    for one in runs:
        rows = np.array(one["rows"])
        out, codes = blank(len(rows))
        begun = thread_time()
        run_many(rows, one["periods"], one["rtol"], one["settle"], out, codes)
        seconds += thread_time() - begun
        told += codes[:, [CODE_STATUS, CODE_MODE, CODE_N_EVENTS]].tolist()
    return {"seconds": seconds, "told": told}


def serve() -> None:
    """Measure what each line of the input asks for."""
    for line in sys.stdin:
        asked = json.loads(line)
        print(json.dumps(measure_runs(**asked) if "runs" in asked else measure(**asked)), flush=True)


def worker(tree: Path, cache: Path) -> Worker:
    """A process that measures with the package of one tree."""
    return Worker(Path(__file__), "--serve", tree, cache)


class Effect(NamedTuple):
    """What one shortcut does in one scene: times [s] and errors with it and without, modes of motion."""

    shortcut: str
    scene: str
    on: float
    off: float
    ratio: float
    error_on: float
    error_off: float
    mode_on: str
    mode_off: str

    @property
    def changes(self) -> bool:
        """Whether the shortcut costs more accuracy than rtol allows."""
        return self.error_on > ALLOWED * max(RTOL, self.error_off)


def compile_copies(shortcuts: list[Shortcut], folder: Path, jobs: int) -> None:
    """A copy of the package without each of them, compiled, in a folder of its own; so many at a time."""

    def compile_copy(k: int) -> None:
        if shortcuts[k].edits:
            copy = without(shortcuts[k], folder / str(k))
            made = worker(copy, copy / "cache")
            made.ask({"scene": {}, "rtol": RTOL})
            made.close()

    with ThreadPoolExecutor(jobs) as threads:
        list(threads.map(compile_copy, range(len(shortcuts))))


def finest_states(whole: Worker, names: list[str]) -> dict[str, np.ndarray]:
    """States of each scene at the tight setting."""
    return {name: np.array(whole.ask({"scene": SCENES[name], "rtol": FINEST})["states"]) for name in names}


def effects(
    shortcut: Shortcut, folder: Path, whole: Worker, finest: dict[str, np.ndarray], turns: int = ROUNDS
) -> Iterator[Effect]:
    """What a shortcut does in each scene, its copy being compiled in `folder`; `whole` measures with the package as it is."""
    bare = worker(folder, folder / "cache") if shortcut.edits else worker(ROOT, KEPT)
    on_one_core([whole, bare])
    for name, states in finest.items():
        asked = {"scene": SCENES[name], "rtol": RTOL}
        rounds = [(whole.ask(asked), bare.ask(asked | shortcut.asked)) for _ in range(turns)]
        times = np.array([[one["seconds"] for one in pair] for pair in rounds])
        on, off = rounds[0]
        yield Effect(
            shortcut.name,
            name,
            *np.median(times, axis=0),
            float(np.median(times[:, 1] / times[:, 0])),
            float(np.abs(np.array(on["states"]) - states).max()),
            float(np.abs(np.array(off["states"]) - states).max()),
            on["mode"],
            off["mode"],
        )
    bare.close()


class Cost(NamedTuple):
    """What it costs to leave a shortcut out of a group of runs: ratios of time and of events, and the verdicts that differ."""

    shortcut: str
    group: str
    ratio: float
    least: float
    most: float
    events: float
    differ: int
    of: int

    def __str__(self) -> str:
        return (
            f"{self.shortcut:50s} {self.group:14s} {self.ratio:6.3f} ({self.least:.2f} to {self.most:.2f})   "
            f"events {self.events:.4f}   {self.differ} of {self.of} verdicts differ"
        )


def costs(shortcut: Shortcut, folder: Path, whole: Worker, groups: dict[str, list[Any]], turns: int) -> Iterator[Cost]:
    """What leaving a shortcut out costs in each group, its copy being compiled in `folder`."""
    bare = worker(folder, folder / "cache")
    on_one_core([whole, bare])
    for group, runs in groups.items():
        asked = {"runs": [one._asdict() for one in runs]}
        rounds = [(whole.ask(asked), bare.ask(asked)) for _ in range(turns)]
        ratios = [off["seconds"] / on["seconds"] for on, off in rounds]
        on, off = (np.array(one["told"]) for one in rounds[0])
        events, differ = off[:, 2].sum() / on[:, 2].sum(), np.any(on[:, :2] != off[:, :2], axis=1)
        yield Cost(
            shortcut.name, group, float(np.median(ratios)), min(ratios), max(ratios), events, int(differ.sum()), len(on)
        )
    bare.close()


def together(shortcuts: list[Shortcut]) -> Shortcut:
    """All of these as one."""
    edits: dict[str, Edit] = {}
    for shortcut in shortcuts:
        for module, edit in shortcut.edits.items():
            edits[module] = in_turn(edits[module], edit) if module in edits else edit
    return Shortcut("all of these together", "", edits)


def print_costs(chosen: list[Shortcut], jobs: int, turns: int) -> None:
    """Print what leaving each of them out costs on what people run."""
    from workload import workload  # reads declarations: not for those who only take copies

    groups = workload()
    with tempfile.TemporaryDirectory() as name:
        compile_copies(chosen, Path(name), jobs)
        whole = worker(ROOT, KEPT)
        for k, shortcut in enumerate(chosen):
            for cost in costs(shortcut, Path(name, str(k)), whole, groups, turns):
                print(cost, flush=True)
        whole.close()


def line(effect: Effect) -> str:
    """One line of the table on the terminal."""
    modes = effect.mode_on if effect.mode_on == effect.mode_off else f"{effect.mode_on} / {effect.mode_off}"
    flag = "  CHANGES THE ANSWER" if effect.changes else ""
    return (
        f"{effect.shortcut:50s} {effect.scene:16s} {1e6 * effect.on:9.0f} {1e6 * effect.off:9.0f} {effect.ratio:8.2f} "
        f"{effect.error_on:9.1e} {effect.error_off:9.1e}  {modes}{flag}"
    )


def grid(found: list[Effect], names: list[str], cell: Callable[[Effect], str]) -> Iterator[str]:
    """A table in Markdown: a row for each shortcut, a column for each scene."""
    yield "| without | " + " | ".join(names) + " |"
    yield "|---|" + "---|" * len(names)
    for shortcut in SHORTCUTS:
        row = {effect.scene: cell(effect) for effect in found if effect.shortcut == shortcut.name}
        if row:
            yield f"| {shortcut.name} | " + " | ".join(row[name] for name in names) + " |"


def errors(effect: Effect) -> str:
    """Errors with and without the shortcut (one of them if they are the same to a digit), and a mode that differs."""
    mode = f" ({effect.mode_off})" if effect.mode_off != effect.mode_on else ""
    on, off = f"{effect.error_on:.0e}", f"{effect.error_off:.0e}"
    return (on if on == off else f"{on} / {off}") + mode


def kernel_revision() -> str:
    """The last change of the kernel that was measured."""
    changed = git("status", "--porcelain", "--", "dimersweep/kernel")
    return git("log", "-1", "--format=%h of %cs", "--", "dimersweep/kernel") + (", changed" if changed else "")


def document(found: list[Effect], names: list[str], revision: str, note: str = "") -> Iterator[str]:
    """The lines of docs/shortcuts.md."""
    changed = [effect for effect in found if effect.changes]
    yield "# What each scene skips"
    yield ""
    yield "Made by `python benchmarks/speed/shortcuts.py`: each shortcut of the kernel is taken out of a copy of it, and the"
    yield f"same scenes are run with it and without, in turn, at `rtol={RTOL:.0e}`."
    yield f"The kernel is that of revision {revision}." + (f" {note}" if note else "")
    yield ""
    yield "| shortcut | what is done without it |"
    yield "|---|---|"
    measured = {effect.shortcut for effect in found}
    for shortcut in SHORTCUTS:
        if shortcut.name in measured:
            yield f"| {shortcut.name} | {shortcut.without} |"
    yield ""
    missing = [shortcut.name for shortcut in SHORTCUTS if shortcut.name not in measured]
    if missing:
        yield f"Not measured yet: {'; '.join(missing)}."
        yield ""
    yield "## Time"
    yield ""
    yield f"Time of a run to its verdict (at most {PERIODS} forcing periods) without the shortcut, over that with it."
    yield "Above 1 the shortcut pays in that scene; near 1 the scene has no use for it."
    yield ""
    yield from grid(found, names, lambda effect: f"{effect.ratio:.2f}")
    yield ""
    yield "## Error"
    yield ""
    yield f"Largest error of the states over {SHORT} periods with the shortcut / without it (one number where both are alike),"
    yield "in units of 1 cm, 0.1 m/s, 1 rad and 1 rad/s (100 rad/s for the spin), against a run at 1e-13. The mode without it"
    yield "is named where it differs."
    yield ""
    yield from grid(found, names, errors)
    yield ""
    if changed:
        yield "Shortcuts that cost more than ten times the larger of `rtol` and the error without them:"
        yield ""
        for effect in changed:
            yield f"- {effect.shortcut}, {effect.scene}: {effect.error_on:.1e}, without it {effect.error_off:.1e}"
    else:
        yield "No shortcut costs more than ten times the larger of `rtol` and the error without it."


def main(arguments: list[str] | None = None) -> list[Effect]:
    """Print the table and write the document."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--only", nargs="+", metavar="WORD", default=[""], help="shortcuts with one of these in the name"
    )
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), metavar="SCENE")
    parser.add_argument("--small", action="store_true", help="two scenes, one timing, and nothing that compiles")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="copies compiled at a time")
    parser.add_argument("--note", default="", help="a sentence for the document, on how it was made")
    parser.add_argument("--document", type=Path, help="where the tables go (default: docs/shortcuts.md if not small)")
    parser.add_argument("--runs", action="store_true", help="measure on what people run in place of the scenes")
    parser.add_argument("--together", action="store_true", help="with --runs: take all of them out of one copy")
    given = parser.parse_args(arguments)
    if given.runs:
        chosen = [one for one in SHORTCUTS if one.edits and any(word in one.name for word in given.only)]
        print_costs([together(chosen)] if given.together else chosen, given.jobs, 1 if given.small else ROUNDS)
        return []
    scenes = given.scenes or (["jump", "frictionless"] if given.small else list(SCENES))
    found = []
    print(
        f"{'without':50s} {'scene':16s} {'on us':>9s} {'off us':>9s} {'off / on':>8s} {'err on':>9s} {'err off':>9s}  mode"
    )
    chosen = [shortcut for shortcut in SHORTCUTS if any(word in shortcut.name for word in given.only)]
    if given.small:
        chosen = [shortcut for shortcut in chosen if not shortcut.edits]
    with tempfile.TemporaryDirectory() as name:
        compile_copies(chosen, Path(name), given.jobs)
        whole = worker(ROOT, KEPT)
        finest = finest_states(whole, scenes)
        for k, shortcut in enumerate(chosen):
            for effect in effects(shortcut, Path(name, str(k)), whole, finest, 1 if given.small else ROUNDS):
                found.append(effect)
                print(line(effect), flush=True)
        whole.close()
    target = given.document or (None if given.small else DOCUMENT)
    if target:
        target.write_text("\n".join(document(found, scenes, kernel_revision(), given.note)) + "\n")
    return found


if __name__ == "__main__":
    if sys.argv[1:] == ["--serve"]:
        serve()
    else:
        main()
