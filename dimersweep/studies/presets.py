"""Find the sweep files that come with the package: one for every dataset of the paper, and more."""

from pathlib import Path

from dimersweep.errors import ParameterError, unknown

_HERE = Path(__file__).parents[1]
# of an installed package, and of a copy of the repository: the first one that has any is taken
FOLDERS = (_HERE / "presets", _HERE.parent / "sweeps")


def presets(kind: str = "") -> dict[str, Path]:
    """Return the files of all presets of a kind, by their names.

    `kind` is the folder of the presets: "" for sweeps, "borders" for files of borders.
    """
    for folder in FOLDERS:
        found = {path.stem: path for path in sorted((folder / kind).glob("*.toml"))}
        if found:
            return found
    return {}


def find_declaration(given: Path, kind: str = "") -> Path:
    """Return the file that `given` names: a path as it is, or the file of the preset of that name.

    `kind` is the folder of the presets, as in `presets`.

    Raises
    ------
    ParameterError
        If `given` is a mere name and no preset has it.
    """
    if given.exists() or given.suffix or given.parent != Path():
        return given
    known = presets(kind)
    if given.name not in known:
        raise ParameterError(unknown(given.name, "preset, and no file", known))
    return known[given.name]
