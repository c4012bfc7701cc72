"""Count what the house weighs: ``python -m tests.checks.house`` prints lines, floors, types, and how docstrings begin.

`tests/test_house.py` holds the numbers to their bounds.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import grimp

PACKAGE = Path(__file__).resolve().parents[2] / "dimersweep"
ANALYSIS = PACKAGE / "analysis"
ORBITS = "dimersweep.analysis.orbits"
ROOMS = ("map", "continuation", "borders", "slow")
# first words of docstrings of functions that name no action: what a function does must then be guessed
NO_VERBS = {
    *(
        "A",
        "All",
        "An",
        "And",
        "Any",
        "As",
        "At",
        "Both",
        "By",
        "For",
        "From",
        "How",
        "If",
        "In",
        "Less",
        "Least",
        "Like",
        "No",
        "None",
    ),
    *(
        "Number",
        "Numbers",
        "Of",
        "One",
        "Points",
        "Rates",
        "Results",
        "See",
        "So",
        "Such",
        "That",
        "The",
        "Their",
        "These",
        "They",
    ),
    *("Those", "Time", "Times", "To", "Values", "What", "When", "Where", "Whether", "Which", "Who", "Why", "With"),
}


def sources(analysis: bool) -> list[Path]:
    """Return the files of the analysis, or of the engine; the two public names of the analysis count with it."""
    doors = {PACKAGE / "orbits.py", PACKAGE / "fits.py"}
    return [path for path in sorted(PACKAGE.rglob("*.py")) if (ANALYSIS in path.parents or path in doors) == analysis]


def lines(analysis: bool) -> int:
    """Count the lines of a house."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in sources(analysis))


def floors() -> dict[str, int]:
    """Count, for each room of orbits, the modules of its longest chain of imports."""
    graph = grimp.build_graph("dimersweep")

    def height(room: str) -> int:
        modules = {name for name in graph.modules if name.startswith(f"{ORBITS}.{room}.")}

        @cache
        def floor(name: str) -> int:
            return 1 + max(
                (floor(each) for each in graph.find_modules_directly_imported_by(name) if each in modules), default=0
            )

        return max(map(floor, modules))

    return {room: height(room) for room in ROOMS}


def types(folder: Path) -> list[str]:
    """Return the names of the classes below a folder."""
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.py")))
    return [node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]


def found_types() -> dict[str, str]:
    """Return the docstrings of the classes of orbits that hold unknowns (`y`, `z`), an `orbit` or a `solution`.

    They stand for what is found: a solution, or something on a branch or a border. Left out are the results that users
    get, which list their attributes, and `SlowMotion`, which an orbit is read from, as from its `Passage`.
    """
    found = {}
    for path in sorted((ANALYSIS / "orbits").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ClassDef) or node.name == "SlowMotion":
                continue
            fields = {ast.unparse(each.target) for each in node.body if isinstance(each, ast.AnnAssign)}
            text = ast.get_docstring(node) or ""
            if fields & {"y", "z", "orbit", "solution"} and "Attributes\n-----" not in text:
                found[node.name] = text
    return found


def steppers() -> set[str]:
    """Return the functions of orbits that step on, and take shorter steps where an orbit is lost.

    They catch the loss in a loop, or call themselves, and halve a number.
    """

    def steps_on(function: ast.FunctionDef) -> bool:
        inside = list(ast.walk(function))
        called = {ast.unparse(node.func).split(".")[-1] for node in inside if isinstance(node, ast.Call)}
        repeated = (
            inside if function.name in called else [node for node in inside if isinstance(node, ast.For | ast.While)]
        )
        caught = [node for part in repeated for node in ast.walk(part) if isinstance(node, ast.ExceptHandler)]
        halves = any(isinstance(node, ast.Constant) and node.value == 0.5 for node in inside)
        return halves and any(node.type is not None and "OrbitLost" in ast.unparse(node.type) for node in caught)

    return {
        f"{path.relative_to(ANALYSIS / 'orbits').as_posix()}: {node.name}"
        for path in sorted((ANALYSIS / "orbits").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and steps_on(node)
    }


def openings() -> Iterator[tuple[str, int, str]]:
    """Yield file, line and first word of the docstring of each function but properties."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            text = ast.get_docstring(node)
            is_property = any("property" in ast.unparse(each) for each in node.decorator_list)
            if text and not is_property:
                yield path.relative_to(PACKAGE).as_posix(), node.lineno, text.split()[0].strip(",.:;")


def builders() -> dict[str, int]:
    """Count, for each module, the places that make a labelled dataset of columns by themselves (`xr.Dataset(...)`)."""
    made = {path: path.read_text(encoding="utf-8").count("xr.Dataset(") for path in sorted(PACKAGE.rglob("*.py"))}
    return {path.relative_to(PACKAGE).as_posix(): count for path, count in made.items() if count}


def naming(word: str) -> int:
    """Count the lines of the package that name a word."""
    return sum(
        word in line for which in (True, False) for path in sources(which) for line in path.read_text().splitlines()
    )


if __name__ == "__main__":
    print(f"lines: engine {lines(False)}, analysis {lines(True)}")
    print(f"floors of the rooms of orbits: {floors()}")
    print(f"classes of orbits: {len(types(ANALYSIS / 'orbits'))}")
    print(f"types of what orbits find: {', '.join(found_types())}")
    print(f"steppers of orbits: {', '.join(sorted(steppers()))}")
    print(f"places that make a dataset: {builders()}")
    print(f"lines that name OrbitLost: {naming('OrbitLost')}")
    first = Counter(word for *_, word in openings())
    print(f"docstrings of functions: {first.total()}, without a verb: {sum(first[word] for word in NO_VERBS)}")
