"""The cubes of all small presets, each by its command, in one process: ``python -m tests.checks.small_cubes FOLDER``."""

import sys
from pathlib import Path

from dimersweep.cli import app


def make_small_cubes(folder: Path) -> None:
    """Run each preset."""
    for preset in sorted((Path(__file__).parents[2] / "sweeps").glob("*-small.toml")):
        app(["run", str(preset), "--out", str(folder / f"{preset.stem}.nc")], standalone_mode=False)


if __name__ == "__main__":
    make_small_cubes(Path(sys.argv[1]))
