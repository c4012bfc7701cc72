"""Scenes and tables of numbers for tests: files in ``tests/data``, each entry with a line on what it broke or shows."""

import tomllib
from pathlib import Path
from typing import Any

DATA = Path(__file__).parents[1] / "data"


def data(name: str) -> dict[str, Any]:
    """What the file of that name holds."""
    return tomllib.loads((DATA / f"{name}.toml").read_text(encoding="utf-8"))
