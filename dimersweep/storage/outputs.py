"""Check outputs before any work is done: their names, their endings, and files that exist already."""

import os
import stat
import tempfile
from pathlib import Path

from dimersweep.errors import ParameterError, StoreError
from dimersweep.storage.formats import FORMATS, format_of

# endings of cubes; endings of single runs, borders, branches and families
CUBES, TABLES = tuple(FORMATS), (".nc",)


def check_output(
    path: str | os.PathLike[str],
    *,
    force: bool = False,
    name: str = "out",
    what: str = "a cube",
    endings: tuple[str, ...] | None = CUBES,
) -> Path:
    """Refuse an output that could not be written, or whose ending promises another format, before any work.

    Parameters
    ----------
    path : path-like
        The output to be written.
    force : bool
        If True, an existing file may be replaced.
    name, what : str
        Names of the parameter and of the output in messages.
    endings : tuple of str, optional
        Allowed endings. Each kind of output has its own (`CUBES`, `TABLES`, and those of pictures, movies and pages),
        so that two outputs of different kinds never have one name. None if the ending was checked before.

    Returns
    -------
    Path
        The path of the output.

    Raises
    ------
    ParameterError
        As by `check_ending`.
    StoreError
        If the output exists, or its folder does not, or no file can be created there. With `force`, too, if it is a
        link, a device or another thing that is no file (or no folder of its format, for a format with folders).
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
    """Return a path as messages show it: quoted if it is empty, or has signs that a terminal would not print."""
    text = str(path)
    return text if text and text.isprintable() else repr(text)


def _no_output(path: Path) -> str:
    """Return the reason why `path` cannot be replaced by a file, or a Zarr group, even if allowed; "" if it can."""
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
    """Return `path` if its ending is one of `endings`.

    Raises
    ------
    ParameterError
        If the ending is another one, which would promise another format.
    """
    if Path(path).suffix not in endings:
        *others, last = endings
        allowed = f"{', '.join(others)} or {last}" if others else last
        raise ParameterError(f"{name} = {_shown(path)}: {what} must end in {allowed}")
    return path


def refuse_input(out: Path, given: Path) -> None:
    """Refuse an output that would replace a file which the same call reads.

    Raises
    ------
    ParameterError
        If both are one file.
    """
    if out.exists() and given.exists() and out.samefile(given):
        raise ParameterError(f"out = {_shown(out)}: would replace what is read; give another name")
