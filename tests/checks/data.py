"""Scenes and tables of numbers for tests: files in ``tests/data``, each entry with a line on what it broke or shows."""

import tomllib
from pathlib import Path
from typing import Any

DATA = Path(__file__).parents[1] / "data"


def data(name: str) -> dict[str, Any]:
    """What the file of that name holds."""
    return tomllib.loads((DATA / f"{name}.toml").read_text(encoding="utf-8"))


def is_told(said: str, line: str) -> bool:
    """Whether a message is a line of a table, or begins with it where that ends in dots."""
    return said.startswith(line[:-3]) if line.endswith("...") else said == line
