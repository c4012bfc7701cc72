"""What each constant of the kernel decides: ``python benchmarks/evidence/constants.py``.

Each number that stands by itself in a file of the kernel is halved and doubled, one at a time, and the same runs are
made: scenes of the whole model as a laboratory might build them, scenes over its whole domain, and long runs about the
base case with their verdicts. All are made by one process: in a copy of the package the constants are read from memory,
so that the kernel is compiled once. It takes half an hour.
"""

import argparse
import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

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

`python benchmarks/evidence/constants.py` halves and doubles each of them, and makes the same {runs} runs each time.
Columns: how many runs have other bits then; by how much their work changes, in hops of one end; by how much the errors
of those with other bits change, over runs at `rtol` 1e-12; and how many statuses and modes are others. One that nothing
notices guards against what these runs lack, or decides nothing.
"""


class Constant(NamedTuple):
    """A number of the kernel; one that no compiled function reads has no file."""

    file: str
    name: str
    value: float
    meaning: str


def number_of(node: ast.expr) -> float | None:
    """The number that an expression of mere numbers is."""
    if any(
        not isinstance(each, ast.Constant | ast.BinOp | ast.UnaryOp | ast.operator | ast.unaryop)
        for each in ast.walk(node)
    ):
        return None
    value = eval(compile(ast.Expression(node), "", "eval"))
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def constants_of(tree: ast.Module) -> Iterator[tuple[str, float]]:
    """Names and numbers that stand by themselves in a file; not the places in arrays and the codes, which count from 0."""
    for node in tree.body:
        if not isinstance(node, ast.Assign):
            continue
        target = node.targets[0]
        both = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
        pairs = zip(target.elts, node.value.elts, strict=True) if both else [(target, node.value)]
        for name, value in pairs:
            number = number_of(value)
            if number is None or not isinstance(name, ast.Name) or abs(number) in (0, 1) or name.id.startswith("N_"):
                continue
            if isinstance(number, float) or number > 3:
                yield name.id, number


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
        lines = file.read_text().splitlines()
        for name, value in constants_of(tree):
            (line,) = (k for k, text in enumerate(lines) if re.match(rf"(\w+, )*{name}\b.* = ", text))
            above = lines[line - 1] if lines[line - 1].startswith("#") else ""
            meanings[module, name] = (lines[line].partition("  # ")[2] or above.removeprefix("# ")).replace("|", "/")
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
        Constant(
            module.removeprefix("dimersweep.kernel.") if k in used else "",
            name,
            value,
            meanings.get((module, name), ""),
        )
        for k, ((module, name), value) in enumerate(names.items())
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
    from dimersweep.parameters import fill_rows
    from tests.checks.random_scenes import Watch, rows_of

    rng = np.random.default_rng(7)
    near, far = rows_of(0, 300, 7, "whole"), rows_of(1, 120, 7, "whole")
    about = {"Gamma": rng.uniform(0.7, 1.6, 40), "e": rng.uniform(0.4, 0.8, 40), "beta0": rng.uniform(0.0, 0.6, 40)}
    from dimersweep.symbols import BASE

    base = fill_rows({name: np.full(40, value) for name, value in BASE.items()} | about, 40)
    space, found = new_workspace(), []
    watch = Watch(space, LONGEST)
    for rows, periods, settle in ((near, 12, False), (far, 3, False), (base, 120, True)):
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


def measured(made: Answers, usual: Answers, exact: Answers) -> str:
    """The columns of a change."""
    alike = (made.states == usual.states) | (np.isnan(made.states) & np.isnan(usual.states))
    other = ~alike.all(axis=1) | (made.codes != usual.codes).any(axis=1)
    if not other.any():
        return "| 0 | | | | "
    ratio = np.log((errors(made, exact)[other] + 1e-14) / (errors(usual, exact)[other] + 1e-14)).mean()
    changed = (made.codes != usual.codes)[:, :2].sum(axis=0)
    more = 100 * (made.work.sum() / usual.work.sum() - 1)
    return f"| {other.sum()} | {more:+.1f} % | {100 * np.expm1(ratio):+.0f} % | {changed[0]} | {changed[1]} "


def ask(constants: list[Constant], parts: list[str], rtol: float) -> None:
    """Print a table for each file."""
    from dimersweep.knobs import VALUES

    exact, usual = battery(1e-12), battery(rtol)
    print(HEAD.format(runs=len(usual.work)), end="", flush=True)
    before = ""
    for k, (file, name, value, meaning) in enumerate(constants):
        if not file or (parts and not any(part in f"{file}.{name}" for part in parts)):
            continue
        if file != before:
            print(f"\n## {file}\n\n| constant | value | what it is | | bits | work | error | status | mode |")
            print("|---|---|---|---|---|---|---|---|---|")
            before = file
        cells = []
        for factor in (0.5, 2.0):
            VALUES[k] = value * factor if isinstance(value, float) else max(1, int(value * factor))
            cells.append(measured(battery(rtol), usual, exact))
            VALUES[k] = value
        print(f"| {name} | {value} | {meaning} | /2 {cells[0]}|\n| | | | x2 {cells[1]}|", flush=True)


def main() -> None:
    """Make the copy, and ask in a process that imports it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help="parts of the names of constants; all by default")
    parser.add_argument("--rtol", type=float, default=1e-8)
    given = parser.parse_args()
    if where := os.environ.get("CONSTANTS_COPY"):
        constants = [Constant(*each) for each in ast.literal_eval(Path(where, "constants.txt").read_text())]
        ask(constants, given.parts, given.rtol)
        return
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
        raise SystemExit(
            subprocess.run(
                [sys.executable, __file__, *sys.argv[1:]], check=False, env=os.environ | environment
            ).returncode
        )


if __name__ == "__main__":
    main()
