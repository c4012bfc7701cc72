"""What each constant of the kernel decides: see `constants.py`.

The same runs are made each time: scenes of the whole model as a laboratory might build them, scenes over its whole domain,
long runs about the base case with their verdicts, and the scenes of ``tests/data/stress.toml``, each of which once failed.
All are made by one process: in a copy of the package the constants are read from memory, so that the kernel is compiled
once. It takes half an hour.
"""

import ast
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from constants_table import FACTORS, Constant, changed, meaning_of, numbers, print_table

RTOL = 1e-8  # of the runs
LONGEST = 0.3  # time for a run [s]: one that takes longer than any of them should is stopped
ROOT = Path(__file__).resolve().parents[2]
READERS = '''"""Constants that are read from memory."""

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

VALUES = np.array({values})


def _reader(number, kind):
    def load(context, builder, *_):
        address = ir.Constant(ir.IntType(64), VALUES.ctypes.data + 8 * number)
        value = builder.load(builder.inttoptr(address, ir.DoubleType().as_pointer()))
        return value if kind is types.float64 else builder.fptosi(value, ir.IntType(64))

    return intrinsic(lambda typing: (kind(), load))


for k in range(VALUES.size):
    globals()[f"real_{{k}}"], globals()[f"whole_{{k}}"] = _reader(k, types.float64), _reader(k, types.int64)
'''
HEAD = """# What the constants of the kernel decide

`python benchmarks/evidence/constants.py kernel` halves and doubles each of them, and makes the same {runs} runs each time:
random scenes over the whole model, long runs about the base case, and all scenes that once failed. The last column has what
it notices, halved / doubled: runs with other bits; change of the work, in hops of one end; change of the errors of those runs
with other bits, against runs at `rtol` 1e-12; other statuses; other modes. What none of these runs notices is a guard, with
the reason why it stands. Places in arrays and codes are not listed, nor are numbers of mathematics (coefficients of
elementary functions and of the one-step methods, which `tests/kernel` computes again).
"""
CODES = ("LEAVES_CHART", "WIDTH")
MATHEMATICS = tuple(f"kernel.numerics.{name}" for name in ("elementary", "sincos", "tableaux", "collocation"))


def constants_of(tree: ast.Module) -> Iterator[tuple[str, float]]:
    """Names and numbers of a file; not the rows, the places in arrays and the codes, which count from 0."""
    for name, _, number in numbers(tree):
        counts = name.startswith("N_") or name in CODES or "[" in name
        if not counts and (number > 3 or isinstance(number, float)) and abs(number) != 1:
            yield name, number


def is_compiled(node: ast.AST) -> bool:
    """Whether a function is one of the kernel's."""
    return isinstance(node, ast.FunctionDef) and any(
        getattr(getattr(each, "func", each), "id", "") in ("compiled", "exported") for each in node.decorator_list
    )


def places(tree: ast.Module) -> set[str]:
    """Names that are used as places in arrays, or beside compiled functions: not ours to change."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript):
            found |= {each.id for each in ast.walk(node.slice) if isinstance(each, ast.Name)}
    outside = [each for each in tree.body if not is_compiled(each)]
    return found | {
        each.id
        for part in outside
        for each in ast.walk(part)
        if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Load)
    }


def bounds_of(tree: ast.Module) -> set[str]:
    """Names that numbers are compared with, or that count the passes of a loop."""
    found = set()
    for node in ast.walk(tree):
        loops = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "range" and len(node.args) == 1
        if loops or isinstance(node, ast.Compare):
            found |= {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
    return found


class Reads(ast.NodeTransformer):
    """Has compiled functions read constants from memory."""

    def __init__(self, numbers: dict[str, tuple[int, bool]]) -> None:
        self.numbers, self.used = numbers, set[int]()
        self.inside = False

    def visit_FunctionDef(self, node: ast.FunctionDef) -> Any:
        if is_compiled(node):
            self.inside = True
            node.body = [self.visit(each) for each in node.body]
            self.inside = False
        return node

    def visit_Name(self, node: ast.Name) -> Any:
        if not self.inside or node.id not in self.numbers or not isinstance(node.ctx, ast.Load):
            return node
        number, is_whole = self.numbers[node.id]
        self.used.add(number)
        reader = ast.Attribute(ast.Name("knobs", ast.Load()), f"{'whole' if is_whole else 'real'}_{number}", ast.Load())
        return ast.Call(reader, [], [])


def make_copy(folder: Path) -> list[Constant]:
    """A copy of the package that reads constants from memory, and these."""
    shutil.copytree(ROOT / "dimersweep", folder / "dimersweep", ignore=shutil.ignore_patterns("__pycache__"))
    kernel = folder / "dimersweep" / "kernel"
    files = {file: ast.parse(file.read_text()) for file in sorted(kernel.rglob("*.py")) if "compiler" not in file.parts}
    names: dict[tuple[str, str], float] = {}
    barred, bounds = set[str](), set[str]()
    for tree in files.values():
        barred |= places(tree)
        bounds |= bounds_of(tree)
    meanings = {}
    for file, tree in files.items():
        module = ".".join(file.relative_to(folder).with_suffix("").parts)
        text = file.read_text()
        for name, value in constants_of(tree):
            meanings[module, name] = meaning_of(text, name)
            if isinstance(value, float) or (name not in barred and name in bounds):
                names[module, name] = value
    listed = list(names)
    used = set[int]()
    for file, tree in files.items():
        module = ".".join(file.relative_to(folder).with_suffix("").parts)
        own = {name: listed.index((module, name)) for at, name in listed if at == module}
        for node in tree.body:
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    if (node.module, alias.name) in names:
                        own[alias.asname or alias.name] = listed.index((node.module, alias.name))
        reads = Reads({name: (k, isinstance(names[listed[k]], int)) for name, k in own.items()})
        body = reads.visit(tree).body
        used |= reads.used
        first = next((k for k, node in enumerate(body) if not isinstance(node, ast.Expr)), 1)
        body[first:first] = ast.parse("from dimersweep import knobs").body
        file.write_text(ast.unparse(ast.fix_missing_locations(tree)))
    (folder / "dimersweep" / "knobs.py").write_text(READERS.format(values=[float(each) for each in names.values()]))
    return [
        Constant(at[0].removeprefix("dimersweep.") if k in used else "", at[1], value, meanings[at])
        for k, (at, value) in enumerate(names.items())
    ]


class Answers(NamedTuple):
    """What a set of runs gives."""

    states: np.ndarray
    codes: np.ndarray
    out: np.ndarray
    work: np.ndarray


def battery(rtol: float) -> Answers:
    """The runs."""
    from dimersweep.kernel.batch import run_many
    from dimersweep.kernel.course import new_workspace
    from dimersweep.kernel.model.layout import N_CODES, N_OUT
    from dimersweep.parameters import Parameters, fill_rows
    from dimersweep.symbols import BASE
    from tests.checks.data import data
    from tests.checks.random_scenes import Watch, rows_of, scene_row

    rng = np.random.default_rng(7)
    near, far = rows_of(0, 160, 7, "whole"), rows_of(1, 80, 7, "whole")
    about = {"Gamma": rng.uniform(0.7, 1.6, 30), "e": rng.uniform(0.4, 0.8, 30), "beta0": rng.uniform(0.0, 0.6, 30)}
    base = fill_rows({name: np.full(30, value) for name, value in BASE.items()} | about, 30)
    once = data("stress")
    hard = [Parameters(**case["scene"]).row() for kind in ("mended", "jamming", "faint") for case in once[kind]]
    hard += [scene_row(number, 11, "whole") for case in once["one_moment"] for number in case["numbers"]]
    space, found = new_workspace(), []
    watch = Watch(space, LONGEST)
    for rows, periods, settle in ((near, 12, False), (far, 3, False), (base, 120, True), (hard, 3, False)):
        for row in rows:
            watch.restart()
            out, codes = np.full((1, N_OUT), np.nan), np.zeros((1, N_CODES), np.int64)
            run_many(row[None], periods, rtol, settle, out, codes, 0, space)
            found.append((space.state.copy(), codes[0], out[0], float(space.work.meter[0].spent)))
    watch.over.set()
    return Answers(*(np.array(column) for column in zip(*found, strict=True)))


def errors(found: Answers, exact: Answers) -> np.ndarray:
    """How far the ends of runs are from the exact ones, relative."""
    size = np.maximum(np.abs(exact.states), 1e-3 * np.nanmax(np.abs(exact.states), axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.abs(found.states - exact.states) / size, nan=1.0).max(axis=1)


def measured(made: Answers, usual: Answers, exact: Answers) -> list[str]:
    """What a change changes: bits, work, errors, statuses, modes."""
    alike = (made.states == usual.states) | (np.isnan(made.states) & np.isnan(usual.states))
    other = ~alike.all(axis=1) | (made.codes != usual.codes).any(axis=1)
    if not other.any():
        return ["0"] * 5
    ratio = np.log((errors(made, exact)[other] + 1e-14) / (errors(usual, exact)[other] + 1e-14)).mean()
    more, off = made.work.sum() / usual.work.sum() - 1, np.expm1(min(ratio, 20.0))
    statuses, modes = (made.codes != usual.codes)[:, :2].sum(axis=0)
    shares = [f"{share:+.1%}" if share < 10 else "> 10" for share in (more, off)]
    return [str(other.sum()), *shares, str(statuses), str(modes)]


def listed(constants: list[Constant]) -> list[Constant]:
    """Those that are in the table."""
    return [each for each in constants if each.file and each.file not in MATHEMATICS]


def ask(parts: list[str]) -> None:
    """Make the copy, and ask in a process that imports it."""
    with tempfile.TemporaryDirectory() as folder:
        constants = make_copy(Path(folder))
        Path(folder, "constants.txt").write_text(repr([tuple(each) for each in constants]))
        shutil.copytree(ROOT / "tests", Path(folder, "tests"), ignore=shutil.ignore_patterns("__pycache__"))
        environment = {
            "CONSTANTS_COPY": folder,
            "PYTHONPATH": folder,
            "NUMBA_CACHE_DIR": str(Path(folder, "cache")),
            "DIMERSWEEP_OTHER_PHYSICS": "1",
        }
        subprocess.run([sys.executable, __file__, *parts], check=True, env=os.environ | environment)


def main() -> None:
    """Ask in the copy."""
    from dimersweep.knobs import VALUES

    constants = [
        Constant(*each) for each in ast.literal_eval(Path(os.environ["CONSTANTS_COPY"], "constants.txt").read_text())
    ]
    exact, usual = battery(1e-12), battery(RTOL)

    def told(one: Constant) -> str:
        found, k = [], constants.index(one)
        for factor in FACTORS:
            VALUES[k] = changed(one.value, factor)
            found.append(measured(battery(RTOL), usual, exact))
            VALUES[k] = one.value
        names = ("bits", "work", "errors", "statuses", "modes")
        return ", ".join(f"{name} {a} / {b}" for name, a, b in zip(names, *found, strict=True) if {a, b} != {"0"})

    print_table(HEAD.format(runs=len(usual.work)), listed(constants), sys.argv[1:], told)


if __name__ == "__main__":
    main()
