"""Outputs, checked before any work is done: names, endings, and what is there already."""

import os
import stat
import tempfile
from pathlib import Path

from dimersweep.errors import ParameterError, StoreError
from dimersweep.storage.formats import FORMATS, format_of

CUBES, TABLES = tuple(FORMATS), (".nc",)  # of sweeps; of single runs, borders, branches and families


def check_output(
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    name: str = "out",
    what: str = "a cube",
    endings: tuple[str, ...] | None = CUBES,
) -> Path:
    """Refuse an output that could not be written, or whose ending promises another format, before any work is done.

    Parameters
    ----------
    path : path-like
        The file to be.
    force : bool
        Whether it may replace an existing file.
    name, what : str
        What the message calls it.
    endings : tuple of str, optional
        Each kind of output has endings of its own (`CUBES`, `TABLES`, and those of pictures, movies and pages), so that two
        outputs of different kinds never have one name. None: its ending was checked before.

    Raises
    ------
    ParameterError
        As by `check_ending`.
    StoreError
        If it exists, or its folder does not, or nothing can be created there; and, `force` or not, if it is a link, a
        device or anything else that is no file (or no folder of its format, for an ending of one that has folders).
    """
    if endings is not None:
        check_ending(os.fspath(path), name=name, what=what, endings=endings)
    path = Path(path)
    wrong, folder = _no_output(path), path.parent
    if not wrong and not folder.is_dir():
        wrong = f"the folder {_shown(folder)} does not exist"
    elif not wrong and path.exists() and not force:
        wrong = "exists already; give another name, or force it to be replaced (force=True)"
    elif not wrong:
        try:
            with tempfile.TemporaryFile(dir=folder):
                return path
        except OSError as error:
            wrong = f"the folder {_shown(folder)} is not writable ({error.strerror})"
    raise StoreError(f"{name} = {_shown(path)}: {wrong}")


def _shown(path: str | os.PathLike[str]) -> str:
    """A path as a message shows it: none and signs that a terminal would take for its own are seen."""
    text = str(path)
    return text if text and text.isprintable() else repr(text)


def _no_output(path: Path) -> str:
    """Why `path` cannot be replaced by a file, or a Zarr group, whoever allows it; "" if it can."""
    try:
        kind = os.lstat(path).st_mode
    except FileNotFoundError:
        return ""
    except (OSError, ValueError) as error:  # too long, with a NUL, below a file
        return f"cannot be a file ({getattr(error, 'strerror', None) or error})"
    if stat.S_ISLNK(kind):
        return f"is a link to {os.readlink(path)}; give the name of the file itself"
    named = format_of(path)
    if stat.S_ISDIR(kind) and not named.marker:
        return "is a folder; give a file name"
    if stat.S_ISDIR(kind):
        foreign = any(path.iterdir()) and not (path / named.marker).is_file()
        return f"is a folder, but no {named.noun}; give another name" if foreign else ""
    if not stat.S_ISREG(kind):
        return "is no regular file; give another name"
    return f"is a file, where a {named.noun} is a folder; give another name" if named.marker else ""


def check_ending(path: str, *, name: str = "out", what: str = "a cube", endings: tuple[str, ...] = CUBES) -> str:
    """`path`, if its ending is one of `endings`.

    Raises
    ------
    ParameterError
        If it is not: the ending would promise another format.
    """
    if Path(path).suffix not in endings:
        *others, last = endings
        allowed = f"{', '.join(others)} or {last}" if others else last
        raise ParameterError(f"{name} = {_shown(path)}: {what} must end in {allowed}")
    return path


def refuse_input(out: Path, given: Path) -> None:
    """Refuse an output that would replace a file that the same call reads.

    Raises
    ------
    ParameterError
    """
    if out.exists() and given.exists() and out.samefile(given):
        raise ParameterError(f"out = {_shown(out)}: would replace what is read; give another name")
