"""The declared sweeps that come with the package: every dataset of the paper, and more."""

from pathlib import Path

from dimersweep.errors import ParameterError, unknown

_HERE = Path(__file__).parents[1]
FOLDERS = (_HERE / "presets", _HERE.parent / "sweeps")  # of an installed package, and of a copy of the repository


def presets(kind: str = "") -> dict[str, Path]:
    """The files of all presets, by their names; of declarations of borders with "borders"."""
    for folder in FOLDERS:
        found = {path.stem: path for path in sorted((folder / kind).glob("*.toml"))}
        if found:
            return found
    return {}


def find_declaration(given: Path, kind: str = "") -> Path:
    """The file that is meant by `given`: a path, or the name of a preset of that kind, see `presets`.

    Raises
    ------
    ParameterError
        If it is neither.
    """
    if given.exists() or given.suffix or given.parent != Path():
        return given
    known = presets(kind)
    if given.name not in known:
        raise ParameterError(unknown(given.name, "preset, and no file", known))
    return known[given.name]
