"""Numbers that stand by themselves in the files of a room, and the lines that tell what each of them decides."""

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

TABLE = Path(__file__).with_name("constants.md")
FACTORS = 0.5, 2.0
MEASURES = (
    "bits",
    "work",
    "answers",
)  # with which a cell begins that says what notices a number, and not why it stands


class Constant(NamedTuple):
    """A number of a room; one that nothing reads has no file."""

    file: str  # within the package, as kernel.chatter
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


def numbers(tree: ast.Module) -> Iterator[tuple[str, ast.expr, float]]:
    """Names of numbers in a file, with the place in their row, the expressions, and the numbers, but for zeros."""
    for node in tree.body:
        if not isinstance(node, ast.Assign):
            continue
        target, value = node.targets[0], node.value
        both = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        for name, whole in zip(target.elts, value.elts, strict=True) if both else [(target, value)]:
            if not isinstance(name, ast.Name):
                continue
            row = {"": whole}
            if isinstance(whole, ast.Tuple):
                row = {f"[{k}]": each for k, each in enumerate(whole.elts)}
            elif isinstance(whole, ast.Call):
                row = {f".{each.arg}": each.value for each in whole.keywords}
            for place, each in row.items():
                # of a product with a name, as TURN, the number
                part = each.left if isinstance(each, ast.BinOp) and number_of(each.right) is None else each
                if number := number_of(part):
                    yield f"{name.id}{place}", part, number


def changed(number: float, factor: float) -> float:
    """A number times a factor; counts stay counts, and at least 1."""
    return number * factor if isinstance(number, float) else max(1, int(number * factor))


def meaning_of(text: str, name: str) -> str:
    """What the comment beside a number says, or the one above it."""
    lines = text.splitlines()
    (bare,) = re.findall(r"^\w+", name)
    (line,) = (k for k, one in enumerate(lines) if re.match(rf"(\w+, )*{bare}\b.* = ", one))
    above: list[str] = []
    while lines[line - 1 - len(above)].startswith("# "):
        above.insert(0, lines[line - 1 - len(above)].removeprefix("# "))
    return (lines[line].partition("  # ")[2] or " ".join(above)).replace("|", "/")


def standing() -> dict[str, tuple[str, str, str]]:
    """What stands in the table: by file and name the value, what it decides, and what notices it."""
    found, file = {}, ""
    for line in TABLE.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            file = line.removeprefix("## ")
        elif (row := re.match(r"\| (\S+) \| (\S+) \| (.*) \| (.*) \|$", line)) and row[1] != "constant":
            found[f"{file}.{row[1]}"] = row[2], row[3], row[4]
    return found


def print_table(head: str, constants: list[Constant], parts: list[str], told: Callable[[Constant], str]) -> None:
    """Print what notices each constant with one of the parts in its name; of what nothing notices the reason that stands."""
    print(head, end="", flush=True)
    before, reasons = "", {name: last for name, (*_, last) in standing().items() if not last.startswith(MEASURES)}
    for one in constants:
        full = f"{one.file}.{one.name}"
        if parts and not any(part in full for part in parts):
            continue
        if one.file != before:
            print(f"\n## {one.file}\n\n| constant | value | what it decides | what notices it |\n|---|---|---|---|")
            before = one.file
        print(f"| {one.name} | {one.value} | {one.meaning} | {told(one) or reasons.get(full, '')} |", flush=True)
