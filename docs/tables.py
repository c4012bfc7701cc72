"""Tables of the site, written from the words of the package itself, so that a page cannot name what the code does not have."""

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

from IPython.display import Markdown

from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS
from dimersweep.analysis.orbits.map.orbit import COLUMNS, MULTIPLIERS, TEXTS
from dimersweep.cubes.cube import FLAGS
from dimersweep.cubes.grid import MAX_POINTS
from dimersweep.cubes.results import POINT_MESSAGES, POINT_STATUSES, RESULT
from dimersweep.kernel.model.layout import HARMONICS
from dimersweep.parameters import RULES
from dimersweep.symbols import (
    BASE,
    DI_END_MEANINGS,
    ENDS,
    EVENT_QUANTITIES,
    FORCES,
    HIGHER,
    INSTEAD,
    LEFT_OUT,
    MODE_MEANINGS,
    PARAMETERS,
    QUANTITIES,
    SETTINGS,
    STATE_QUANTITIES,
    TRACK_MEANINGS,
    WORKS,
    Quantity,
    symbol,
)

BYTES_IN_CUBE = 468  # of memory, a point of a cube that is written as NetCDF: benchmarks/speed/memory.py
SWEEPS = Path(__file__).resolve().parents[1] / "sweeps"

# what the words of the flags stand for; a word that is missing here stops the build
WORDS = {
    "mode": MODE_MEANINGS,
    "outcome": MODE_MEANINGS,
    "region": MODE_MEANINGS | {"mixed": "the runs led to several modes, and none of them is the one asked for"},
    "status": dict(zip(POINT_STATUSES, POINT_MESSAGES, strict=True)),
    "di_end": DI_END_MEANINGS,
    "track": TRACK_MEANINGS,
    "answer": {
        "not_run": "the point has not been searched",
        "no": "certain: no",
        "yes": "certain: yes",
        "unsure": "runs failed or did not settle, and the answer depends on them",
    },
    "computed": {"no": "the values are those of the cell around the point", "yes": "runs were made at this point"},
    "direction": {
        "up": "from the least value of the last axis to its greatest",
        "down": "from its greatest value to its least",
    },
    "confidence": {
        "not_run": "the point was not certified",
        "certain": "both further runs come to the same mode and settle in the same period",
        "unsure": "they settle in another period, or the motion has not settled",
        "changed": "a further run comes to another mode: a border is that near",
    },
}

# global attributes of a cube
ATTRIBUTES = {
    "Conventions": "version of the CF conventions that the file follows",
    "title": "what the cube shows",
    "source": "program and version",
    "references": "the paper",
    "history": "when the cube was made (UTC)",
    "dimersweep_cube": "version of this layout",
    "configuration": "all that decides the numbers, as JSON: axes, fixed parameters, periods, accuracy, version of the kernel",
    "configuration_sha256": "checksum of that text; a cube in which they differ is refused",
    "values_sha256": "checksum of coordinates and values; a cube in which they differ is not gone on with",
    "kernel_version": "checksum of the code that the numbers come from, without comments and docstrings",
    "git_commit": "revision of the program, or unknown",
    "git_dirty": "whether its files had been changed since",
    "python": "version",
    "numpy": "version",
    "numba": "version",
    "llvmlite": "version",
    "cpu": "name of the processor of the machine that made the cube",
    "platform": "its operating system",
    "wall_time_s": "duration of the sweep in seconds, over all its starts",
    "kernel_time_s": "sum of the times of all threads or workers in seconds",
}
SOMETIMES = {
    "plot": "kind of picture that the file declares",
    "extends": "the cube whose points were taken over (`--extend`)",
    "failures": "what kept points from having results",
}


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> Markdown:
    lines = [head, ("---",) * len(head), *rows]
    return Markdown("\n".join("| " + " | ".join(line) + " |" for line in lines))


def _unit(units: str) -> str:
    """A unit as it is in the file, kept on one line."""
    return units.replace(" ", "\u00a0").replace("-", "\u2011")


def _allowed(name: str) -> str:
    """What the rules of a parameter allow, without the value that a message would name, and without its explanation."""
    names = (name, *(both for both, ends in ENDS.items() if name in ends))
    rules = [
        re.sub(r"( with \w+)? = \{\}| \(.*\)", "", rule.allowed.format(rule.other, "{}"))
        for rule in RULES
        if rule.name in names
    ]
    return " and ".join(dict.fromkeys(rules)).replace("<", "&lt;") or "any number"


def _left_out(name: str) -> str:
    """What a parameter that is not in the base case is where it is not given."""
    value = LEFT_OUT[name]
    return f"`{value}`" if isinstance(value, str) else f"{value:g}"


def parameters() -> Markdown:
    """Every parameter of the model."""
    rows = (
        (
            f"`{name}`",
            symbol(name, tex=True),
            quantity.long_name,
            _unit(quantity.units),
            f"{BASE[name]:.6g}" if name in BASE else _left_out(name),
            _allowed(name),
        )
        for name, quantity in PARAMETERS.items()
        if name not in HIGHER
    )
    instead = (
        (f"`{name}`", f"${name}$", quantity.long_name, _unit(quantity.units), "", "of single runs, or fixed")
        for name, (_, quantity) in INSTEAD.items()
    )
    last = f"`Gamma_3`, `phi_3` to `phi_y_{HARMONICS}`"
    higher = (
        last,
        "",
        "[harmonics of the plate](plate.md) along its normal and its axes X, Y",
        "",
        "0",
        "as of the first ones",
    )
    return _table(("name", "symbol", "meaning", "unit", "base case", "allowed"), (*rows, higher, *instead))


def _quantities(quantities: dict[str, Quantity]) -> Markdown:
    rows = ((f"`{name}`", quantity.long_name, _unit(quantity.units)) for name, quantity in quantities.items())
    return _table(("name", "meaning", "unit"), rows)


def quantities() -> Markdown:
    """Every variable that a cube may have besides its axes."""
    return _quantities(
        {name: quantity for name, quantity in QUANTITIES.items() if name not in ("outcome", "direction")}
    )


def settings() -> Markdown:
    """The coordinates that tell how the runs of a cube were made."""
    return _quantities(SETTINGS)


def events() -> Markdown:
    """The columns of ``run.events``."""
    return _quantities(EVENT_QUANTITIES)


def states() -> Markdown:
    """The variables of ``run.states(t)``."""
    return _quantities(STATE_QUANTITIES | FORCES)


def works() -> Markdown:
    """The terms of ``run.energy()``."""
    return _quantities(WORKS)


def orbits() -> Markdown:
    """The attributes of an orbit that stand in every dataset of orbits."""
    return _quantities(COLUMNS | MULTIPLIERS | TEXTS)


def borders() -> Markdown:
    """Every kind of border."""
    return _table(("kind", "what happens there"), ((f"`{name}`", kind.meaning) for name, kind in BORDER_KINDS.items()))


def flags(name: str) -> Markdown:
    """Codes, words and meanings of a flag variable."""
    rows = ((str(code), f"`{word}`", WORDS[name][word]) for code, word in enumerate(FLAGS[name]))
    return _table(("code", "word", "meaning"), rows)


def attributes(named: dict[str, str]) -> Markdown:
    """Attributes and their meanings."""
    return _table(("attribute", "meaning"), ((f"`{name}`", meaning) for name, meaning in named.items()))


def scale() -> Markdown:
    """What sweeps of points of 1 ms take: memory of the driver, the store of finished points, time."""
    rows = (
        (
            f"$10^{{{power}}}$",
            "refused" if 10**power > MAX_POINTS else _gigabytes(BYTES_IN_CUBE * 10**power),
            "below 2 GB" if power > 8 else "below 1 GB",
            _gigabytes(RESULT.itemsize * 10**power),
            f"{10 ** (power - 6):,} s",
        )
        for power in (6, 7, 8, 9)
    )
    return _table(("points", "memory, NetCDF", "memory, Zarr", "store", "time"), rows)


def _gigabytes(size: float) -> str:
    return f"{1e-9 * size:.2g} GB" if size < 1e11 else f"{1e-9 * size:.0f} GB"


def presets() -> Markdown:
    """Every sweep file that has a small one beside it."""
    rows = []
    for small in sorted(SWEEPS.glob("*-small.toml")):
        name = small.stem.removesuffix("-small")
        declared = tomllib.loads((SWEEPS / f"{name}.toml").read_text(encoding="utf-8"))
        marks = {declared.get("search", {}).get("over"): " (searched)"}
        if declared["sweep"].get("carry"):
            marks[list(declared["grid"])[-1]] = " (the state is carried along it)"
        varied = declared.get("grid") or declared["points"]["columns"]
        axes = ", ".join(f"`{axis}`{marks.get(axis, '')}" for axis in varied)
        rows.append((f"`{name}`", declared["sweep"]["title"], axes))
    return _table(("name", "what it holds", "axes"), rows)
