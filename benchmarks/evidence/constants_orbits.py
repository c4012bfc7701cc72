"""What each constant of the orbits decides: ``python benchmarks/evidence/constants_orbits.py``.

Each number that stands by itself in a file of `dimersweep/orbits` is halved and doubled, one at a time, and the same is asked:
orbits of several motions, branches with their special points, borders of random dimers, a curve of a change of symbols, a
family, which motions it tells apart, an edge. Each change is made in a process of its own, which reads the changed source; the
kernel is loaded once.
"""

import argparse
import ast
import importlib.abc
import importlib.machinery
import multiprocessing
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from borders_random import random_dimer
from constants import number_of

import dimersweep

ROOM = "dimersweep.orbits"
FOLDER = Path(dimersweep.__file__).parent / "orbits"
LONGEST = 60.0  # time of the processor for all answers [s]
ALIKE = 1e-7  # relative difference of numbers up to which an answer is the same
JUMP: dict[str, Any] = {"Gamma": 1.3, "beta0": 0.0, "xdot0": 0.0, "periods": 300}
MANY_SEQUENCES: dict[str, Any] = {"e": 0.7, "Gamma": 1.05, "f": 18, "A_r": 7, "r_1": 5.1e-3, "r_2": 5e-3}
DIMERS = {"stable_to": (3, 5, 8, 9), "hop": (3, 7), "chatter": (4, 8)}  # numbers of random dimers
ASKED_OF = {  # files of which few questions are asked: parts of their names
    "edges": ("edge",),
    "families": ("family", "alike"),
    "features": ("alike",),
    "finding": ("drift", "plane", "far", "jump", "slips", "word", "alike", "family over"),
    "following": ("down", "up"),
    "bifurcation_curve": ("fold", "flip", "stable_to"),
    "stability_end": ("stable_to",),
    "sequence_curve": ("hop", "chatter", "curve"),
    "plane_curve": ("curve",),
}
HEAD = """
## Orbits

`python benchmarks/evidence/constants_orbits.py` halves and doubles each number of `dimersweep/orbits`, and asks the same
questions each time, those that its file has to do with. Columns: by how much the work changes, in forcing periods of the map;
and which answers differ by more than {alike:g} (`~` by less than a thousandth, `lost` if there is none any more). One that
nothing notices guards against what these questions lack.

| constant | value | what it is | | work | answers |
|---|---|---|---|---|---|"""


def numbers(tree: ast.Module) -> Iterator[tuple[str, ast.expr, float]]:
    """Numbers that stand in the names of a file: a name, with the place in its row, the expression, and the number."""
    for node in tree.body:
        if not isinstance(node, ast.Assign):
            continue
        target, value = node.targets[0], node.value
        both = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        for name, whole in zip(target.elts, value.elts, strict=True) if both else [(target, value)]:
            if not isinstance(name, ast.Name) or not name.id.isupper() or name.id == "TURN":
                continue
            row = whole.elts if isinstance(whole, ast.Tuple) else whole.args if isinstance(whole, ast.Call) else [whole]
            for k, each in enumerate(row):
                # of a product with a name, as TURN, the number
                part = each.left if isinstance(each, ast.BinOp) and number_of(each.right) is None else each
                if number := number_of(part):
                    yield name.id if len(row) == 1 else f"{name.id}[{k}]", part, number


class Changed(importlib.machinery.SourceFileLoader):
    """Loads a file of the room, with one number changed."""

    change: tuple[str, str, float] = "", "", 1.0  # a file, the name of the number, and the factor

    def get_code(self, fullname: str) -> Any:
        """The code of the file."""
        path = self.get_filename(fullname)
        tree = ast.parse(self.get_data(path))
        file, name, factor = self.change
        for each, node, number in numbers(tree) if Path(path).stem == file else ():
            if each == name:
                vars(node).update(vars(ast.parse(repr(changed(number, factor)), mode="eval").body))
                node.__class__ = ast.Constant  # type: ignore[assignment]
        return compile(tree, path, "exec")


def changed(number: float, factor: float) -> float:
    """A number times a factor; counts stay counts, and at least 1."""
    return number * factor if isinstance(number, float) else max(1, int(number * factor))


class Finder(importlib.abc.MetaPathFinder):
    """Finds the files of the room for `Changed`."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        """Where a module of the room is."""
        if not fullname.startswith(f"{ROOM}."):
            return None
        file = str(FOLDER / f"{fullname.rpartition('.')[2]}.py")
        return importlib.machinery.ModuleSpec(fullname, Changed(fullname, file), origin=file)


def questions() -> dict[str, Callable[[], list[Any]]]:
    """What is asked: names, and functions that answer with numbers and words."""
    from dimersweep import orbits, simulate
    from dimersweep.orbits import features

    both = features.Mirrors(True, False)

    def at(spin: float) -> Any:
        return features.features_of_orbit(orbits.find(spin=spin), both)

    def orbit(**given: Any) -> list[Any]:
        one = orbits.find(**given)
        return [one.sequence, one.periods, one.stable, one.spin, one.radius, *np.abs(one.multipliers).tolist()]

    def table(found: Any, *columns: str) -> list[Any]:
        return [entry for name in columns for entry in found[name].values.ravel().tolist()]

    def border(kind: str, over: Any = None, **dimer: float) -> Callable[[], list[Any]]:
        given = {"over": over or {"e": [dimer.pop("e")]}} | dimer
        return lambda: table(orbits.border(kind, "Gamma", **given), "Gamma", "status")

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

    def edge() -> list[Any]:
        found = orbits.edge("beta0", (0.24, 0.28))
        return [found.value, *found.fates, found.stays, found.partner, found.clean]

    begin = orbits.find(spin=100.0)
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
        "curve": lambda: table(orbits.border_curve("hop", "Gamma", "e", span=(0.58, 0.62), spin=100.0), "e", "Gamma"),
        "alike": lambda: [features.Carried(begin, [80.0, 120.0], both).apart(at(spin)) for spin in (85.0, 110.0)],
        "word": lambda: orbit(guess=orbits.find(spin=80.0, **MANY_SEQUENCES), spin=105.0, **MANY_SEQUENCES),
        "family": family(60.0, 140.0, 5),
        "family over sequences": family(88.2, 90.6, 9, **MANY_SEQUENCES),
        "family with ends": family(60.0, 140.0, 9, Gamma=0.78726),
        "family of sections": family(550.0, 572.0, 4, A_r=6.0),
        "edge": edge,
    }


def answers(file: str) -> dict[str, tuple[list[Any], float]]:
    """All answers that a file has to do with, and the forcing periods of the map that each took."""
    from dimersweep.errors import OrbitError
    from dimersweep.orbits import poincare

    spent = [0.0]
    advance = poincare.advance

    def counted(*given: Any) -> int:
        spent[0] += given[3].periods
        return int(advance(*given))

    poincare.advance = counted
    found = {}
    for name, ask in questions().items():
        if file in ASKED_OF and not name.startswith(ASKED_OF[file]):
            continue
        before = spent[0]
        try:
            answer = ask()
        except OrbitError as reason:
            answer = ["lost", str(reason)[:60]]
        found[name] = answer, spent[0] - before
    return found


def in_process(change: tuple[str, str, float], out: Any) -> None:
    """Answer with a number changed."""
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    for name in [name for name in sys.modules if name.startswith(ROOM)]:
        del sys.modules[name]
    vars(dimersweep).pop("orbits", None)
    Changed.change = change
    sys.meta_path.insert(0, Finder())
    try:
        out.send(answers(change[0]))
    except Exception as fault:
        out.send(f"{type(fault).__name__}: {str(fault)[:50]}")


def asked(change: tuple[str, str, float]) -> Any:
    """The answers with a number changed, or in a line why there are none."""
    context = multiprocessing.get_context("fork")
    back, out = context.Pipe(False)
    process = context.Process(target=in_process, args=(change, out))
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


def compared(made: Any, usual: dict[str, tuple[list[Any], float]]) -> str:
    """The columns of a change."""
    if isinstance(made, str):
        return f"| | {made} "
    others = []
    for name, (answer, _) in made.items():
        far = apart(usual[name][0], answer)
        mark = " lost" if answer[:1] == ["lost"] else " ~" if far < 1e-3 else ""
        others += [f"{name}{mark}"] if far > ALIKE else []
    work = sum(cost for _, cost in made.values()) / sum(usual[name][1] for name in made)
    return f"| {100 * (work - 1):+.1f} % | {', '.join(others)} "


def main() -> None:
    """Ask as it is, and with each number changed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help="parts of the names of constants; all by default")
    given = parser.parse_args()
    dimersweep.simulate(periods=3)  # so that the kernel is loaded once
    print(HEAD.format(alike=ALIKE), flush=True)
    for file in sorted(set(FOLDER.glob("*.py")) - {FOLDER / "pictures.py"}):
        lines, usual = file.read_text().splitlines(), {}
        for name, _, number in numbers(ast.parse(file.read_text())):
            where = f"{file.stem}.{name}"
            if given.parts and not any(part in where for part in given.parts):
                continue
            usual = usual or asked((file.stem, "", 1.0))
            line = next(line for line in lines if name.partition("[")[0] in line and " = " in line)
            meaning = line.partition("  # ")[2].replace("|", "/")
            cells = [compared(asked((file.stem, name, factor)), usual) for factor in (0.5, 2.0)]
            print(f"| {where} | {number} | {meaning} | /2 {cells[0]}|\n| | | | x2 {cells[1]}|", flush=True)


if __name__ == "__main__":
    main()
