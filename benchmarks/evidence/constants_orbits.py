"""What each constant of the orbits decides: see `constants.py`.

The same is asked each time: orbits of several motions, branches with their special points, borders of random dimers, curves of
changes of symbols, and where these meet others, families, which motions they tell apart, an edge, sustained spins. Each
change is made in a process of its own, which reads the changed source; the kernel is loaded once. It takes an hour.
"""

import ast
import importlib.machinery
import multiprocessing
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from borders_random import random_dimer
from constants_table import FACTORS, Constant, changed, meaning_of, numbers, print_table

import dimersweep

ROOM, ATTRACTORS = "dimersweep.analysis.orbits", "dimersweep.analysis.attractors"
FOLDER = Path(dimersweep.__file__).parent / "analysis" / "orbits"
EDGES = FOLDER.parent / "attractors" / "edges.py"  # it follows branches, as the rooms of orbits do
LONGEST = 60.0  # time of the processor for all answers [s]
ALIKE = 1e-7  # relative difference of numbers up to which an answer is the same
JUMP: dict[str, Any] = {"Gamma": 1.3, "beta0": 0.0, "xdot0": 0.0, "periods": 300}
MANY_SEQUENCES: dict[str, Any] = {"e": 0.7, "Gamma": 1.05, "f": 18, "A_r": 7, "r_1": 5.1e-3, "r_2": 5e-3}
CHOSEN: dict[str, Any] = {"A_r": 5, "f": 22, "e": 0.65, "mu": 0.1, "mu_s": 0.15, "Gamma": 0.9}
TO_AND_FRO: dict[str, Any] = {
    "r": 4.7e-3, "A_r": 5.55, "f": 18.4, "e": 0.699, "mu": 0.172, "mu_s": 0.276, "Gamma": 0.633,
}  # fmt: skip
GRAZES: dict[str, Any] = {"A_r": 7.0, "spin": 100.0}
DIMERS = {"stable_to": (3, 5, 8, 9), "hop": (3, 7), "chatter": (4, 8)}  # numbers of random dimers
BORDERS = ("fold", "flip", "hop", "stick_slip", "chatter", "curve", "stable")
ASKED_OF = {  # files of which few questions are asked: parts of their names
    "centre": ("centre",),
    "edges": ("edge",),
    "families": ("family", "alike"),
    "features": ("alike",),
    "finding": ("drift", "plane", "far", "jump", "slips", "word", "alike", "family over"),
    "following": ("down", "up"),
    "border_grid": BORDERS,
    "curve": BORDERS,
    "bifurcation_curve": ("fold", "flip", "stable_to"),
    "stability_end": ("stable", "hop"),
    "sequence_curve": ("hop", "stick_slip", "chatter", "curve"),
    "plane_curve": ("curve",),
    "pictures": (),
    "sheets": ("sustained",),
    "slow_flow": ("sustained",),
}
MATHEMATICS = "TURN", "FOLD.at", "FLIP.at"
HEAD = f"""
# What the constants of the orbits decide

`python benchmarks/evidence/constants.py orbits` halves and doubles each number of `dimersweep/analysis/orbits`, and asks the
same questions each time, those that its file has to do with. The last column has what it notices, halved / doubled: change of
the work, in forcing periods of the map; and which answers differ by more than {ALIKE:g} (`~` by less than a thousandth, `lost`
if there is none any more). What none of them notices is a guard, with the reason why it stands.
"""


def listed() -> list[Constant]:
    """Those that are in the table."""
    found = []
    for file in sorted([*FOLDER.rglob("*.py"), EDGES], key=lambda file: file.stem):
        text = file.read_text()
        for name, _, number in numbers(ast.parse(text)):
            if name not in MATHEMATICS:
                found.append(Constant(f"orbits.{file.stem}", name, number, meaning_of(text, name)))
    return found


def load_changed(one: Constant, factor: float) -> None:
    """Have the file of a constant loaded with its number changed."""
    usual = importlib.machinery.SourceFileLoader.get_code

    def get_code(self: Any, fullname: str) -> Any:
        if (
            not fullname.startswith((ROOM, "dimersweep.analysis.attractors.edges"))
            or fullname.rpartition(".")[2] != one.file.rpartition(".")[2]
        ):
            return usual(self, fullname)
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path))
        for name, node, number in numbers(tree):
            if name == one.name:
                body = ast.parse(repr(changed(number, factor)), mode="eval").body
                node.__class__, node.__dict__ = type(body), vars(body)
        return compile(tree, path, "exec")

    importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign]


def questions() -> dict[str, Callable[[], list[Any]]]:
    """What is asked: names, and functions that answer with numbers and words."""
    from dimersweep import names, orbits, simulate
    from dimersweep.analysis.orbits.slow import features

    both = features.Mirrors(True, False)

    def at(spin: float) -> Any:
        return features.features_of_orbit(orbits.find(spin=spin), both)

    def orbit(**given: Any) -> list[Any]:
        one = orbits.find(**given)
        return [one.sequence, one.periods, one.stable, one.spin, one.radius, *np.abs(one.multipliers).tolist()]

    def table(found: Any, *columns: str) -> list[Any]:
        return [entry for name in columns for entry in names(found)[name].values.ravel().tolist()]

    def border(kind: str, over: Any = None, **dimer: float) -> Callable[[], list[Any]]:
        over = over or {"e": [dimer["e"]]}
        fixed = {name: value for name, value in dimer.items() if name not in over}
        columns = ("Gamma", "status", "Gamma_at_meeting", *(["doubling"] if kind == "flip" else []))
        return lambda: table(orbits.border(kind, "Gamma", over, **fixed), *columns)

    def family(low: float, high: float, points: int, **given: float) -> Callable[[], list[Any]]:
        def ask() -> list[Any]:
            found = orbits.family(spin=(low, high), points=points, **given)
            middle = orbits.later(found, spin=float(found["spin"][1]), periods=10)
            return [
                *table(found, "spin", "radius", "spin_drift"),
                found.attrs["low_end"],
                found.attrs["high_end"],
                *middle,
            ]

        return ask

    def sustained(**given: Any) -> Callable[[], list[Any]]:
        columns = "spin_low", "spin_high", "radius_low", "slow_periods", "sheet_high", "high_leads"
        return lambda: table(orbits.sustained(**given), *columns)

    def edge() -> list[Any]:
        found = orbits.edge("beta0", (0.24, 0.28))
        return [found.value, *found.fates, found.stays, found.partner, found.clean]

    def line(kind: str, *e: float, **given: float) -> Callable[[], list[Any]]:
        return border(kind, {"e": list(e)}, spin=100.0, **given)

    def curve(kind: str, *span: float) -> Callable[[], list[Any]]:
        return lambda: table(orbits.border_curve(kind, "Gamma", "e", span=span, spin=100.0), "e", "Gamma", "meets")

    begin = orbits.find(spin=100.0)
    grazes = orbits.find(Gamma=1.345, e=0.46, **GRAZES)
    return {
        "drift": lambda: orbit(spin=100.0),
        "plane": lambda: orbit(spin=0.0),
        "far": lambda: orbit(guess=begin, Gamma=1.1, A_r=8.0, spin=40.0),
        "jump": lambda: orbit(guess=simulate(**JUMP)),
        "slips": lambda: orbit(spin=100.0, mu=0.05, mu_s=0.1),
        "down": lambda: table(orbits.follow(begin, "Gamma", to=0.7, points=60), "Gamma", "special"),
        "up": lambda: table(orbits.follow(begin, "Gamma", to=1.25, points=30, switch=True), "Gamma", "special"),
        **{kind: border(kind, {"A_r": [5.0, 6.0]}, spin=100.0) for kind in ("fold", "flip")},
        **{f"{kind} {k}": border(kind, **random_dimer(k)) for kind, several in DIMERS.items() for k in several},
        "hop meets the flip": line("hop", 0.5, 0.52, 0.54, 0.56),
        "hop that grazes": line("hop", 0.454, 0.458, A_r=7.0),
        "stick_slip": line("stick_slip", 0.6, 0.62, A_r=6.0),
        "chatter": line("chatter", 0.6, 0.64, 0.68, A_r=8.0),
        "curve of the hop": curve("hop", 0.38, 0.44),
        "curve of the flip": curve("flip", 0.54, 0.56),
        "graze": lambda: table(orbits.follow(grazes, "Gamma", to=1.335), "Gamma", "special"),
        "leap": lambda: table(
            orbits.follow(orbits.find(Gamma=1.2825, e=0.59, **GRAZES), "Gamma", to=1.2836), "Gamma", "special"
        ),
        "alike": lambda: [features.Carried(begin, [80.0, 120.0], both).apart(at(spin)) for spin in (85.0, 110.0)],
        "word": lambda: orbit(guess=orbits.find(spin=80.0, **MANY_SEQUENCES), spin=105.0, **MANY_SEQUENCES),
        "family": family(60.0, 140.0, 5),
        "family over sequences": family(88.2, 90.6, 9, **MANY_SEQUENCES),
        "family with ends": family(60.0, 140.0, 9, Gamma=0.78726),
        "family of sections": family(550.0, 572.0, 4, A_r=6.0),
        "edge": edge,
        "centre on a tilted plate": lambda: list(orbits.centre_drift(tilt=1e-3, spin=100.0)[1:]),
        "centre on a plate that sways": lambda: list(orbits.centre_drift(Gamma_x=1e-3, spin=100.0)[1:]),
        "sustained spin": sustained(**CHOSEN),
        "sustained between": sustained(spin=(140.0, 160.0), **TO_AND_FRO),
    }


def answers(file: str) -> dict[str, tuple[list[Any], float]]:
    """All answers that a file has to do with, and the forcing periods of the map that each took."""
    from dimersweep.analysis.orbits.map import poincare
    from dimersweep.errors import OrbitError, ParameterError

    spent = [0.0]
    advance, images = poincare.advance, poincare.images

    def run(*given: Any) -> int:
        spent[0] += given[3].periods
        return int(advance(*given))

    def mapped(*given: Any) -> tuple[int, int]:
        status, count = images(*given)
        spent[0] += count * given[6].periods
        return status, count

    poincare.advance, poincare.images = run, mapped
    found = {}
    for name, ask in questions().items():
        if not name.startswith(ASKED_OF.get(file.removeprefix("orbits."), "")):
            continue
        before = spent[0]
        try:
            answer = ask()
        except (OrbitError, ParameterError) as reason:
            answer = ["lost", str(reason)[:60]]
        found[name] = answer, spent[0] - before
    return found


def in_process(one: Constant, factor: float, out: Any) -> None:
    """Answer with a number changed."""
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    for name in [name for name in sys.modules if name.startswith((ROOM, ATTRACTORS, "dimersweep.orbits"))]:
        del sys.modules[name]
    vars(dimersweep).pop("orbits", None)
    load_changed(one, factor)
    try:
        out.send(answers(one.file))
    except Exception as fault:
        out.send(f"{type(fault).__name__}: {str(fault)[:50]}")


def answered(one: Constant, factor: float) -> Any:
    """The answers with a number changed, or in a line why there are none."""
    context = multiprocessing.get_context("fork")
    back, out = context.Pipe(False)
    process = context.Process(target=in_process, args=(one, factor, out))
    process.start()
    out.close()
    try:
        return back.recv()
    except EOFError:
        return "no answer in time"
    finally:
        process.join()


def apart(a: list[Any], b: list[Any]) -> float:
    """How far two answers are apart: numbers relative to their size, infinite where something else differs."""
    if len(a) != len(b):
        return np.inf
    far = 0.0
    for one, other in zip(a, b, strict=True):
        if isinstance(one, float) and isinstance(other, float) and np.isfinite([one, other]).all():
            far = max(far, abs(one - other) / max(abs(one), 1e-3))
        elif one != other and not (one != one and other != other):
            return np.inf
    return far


def compared(made: Any, usual: dict[str, tuple[list[Any], float]]) -> tuple[str, str]:
    """The change of the work, and the answers that differ."""
    if isinstance(made, str):
        return "?", made
    others = []
    for name, (answer, _) in made.items():
        far = apart(usual[name][0], answer)
        mark = " lost" if answer[:1] == ["lost"] else " ~" if far < 1e-3 else ""
        others += [f"{name}{mark}"] if far > ALIKE else []
    work = sum(cost for _, cost in made.values()) / (sum(usual[name][1] for name in made) or 1.0)
    return f"{100 * (work - 1):+.2g}%" if made and work != 1 else "0", ", ".join(others) or "0"


def ask(parts: list[str]) -> None:
    """Ask as it is, and with each number changed."""
    dimersweep.simulate(periods=3)  # so that the kernel is loaded once
    usual: dict[str, dict[str, tuple[list[Any], float]]] = {}

    def told(one: Constant) -> str:
        if one.file not in usual:
            usual[one.file] = answered(one, 1.0)
        found = [compared(answered(one, factor), usual[one.file]) for factor in FACTORS]
        pairs = zip(("work", "answers"), *found, strict=True)
        return ", ".join(f"{name} {a} / {b}" for name, a, b in pairs if {a, b} != {"0"})

    print_table(HEAD, listed(), parts, told)
