"""Provenance of a cube: the code, the machine and the configuration, as attributes that NetCDF can hold."""

import hashlib
import json
import platform
import re
import reprlib
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from numbers import Integral
from pathlib import Path
from typing import Any, get_args

import numpy as np

from dimersweep.cubes.cube import CONVENTIONS, SOURCE
from dimersweep.errors import ParameterError
from dimersweep.faces import __version__
from dimersweep.inputs import as_number
from dimersweep.kernel import kernel_version
from dimersweep.symbols import Picture

FILE_FORMAT = "1"  # version of the format of cubes and runs
PART = "part"  # key in the configuration of a cube that has a part of its points only; its value is such as 3/20
CHECKSUM = "values_sha256"  # attribute of a cube: the checksum of its coordinates and values
# attributes of a cube that the program sets; a user may set the title and the kind of picture
OURS = {
    *("Conventions", "source", "references", "history", "dimersweep_cube", "configuration", "configuration_sha256"),
    *("kernel_version", "git_commit", "git_dirty", "python", "numpy", "numba", "llvmlite", "cpu", "platform"),
    *("wall_time_s", "kernel_time_s", "extends", CHECKSUM),
}
# attributes that xarray and HDF5 use
_OF_LIBRARIES = {"coordinates", "CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}
ATTRIBUTE_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,99}")
_NO_TEXT = re.compile("[\0\ud800-\udfff]")  # NUL and halves of surrogate pairs, which no file can hold


def digest(configuration: str) -> str:
    """Return the sha256 of the text of a configuration."""
    return hashlib.sha256(configuration.encode()).hexdigest()


def as_text(configuration: Mapping[str, Any]) -> str:
    """Return a configuration as JSON text, of which its digest is taken; numbers keep every digit."""
    return json.dumps(configuration)


def configuration_in(about: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the configuration in the attributes of a cube, or in the metadata of a store, see `configured`.

    Raises
    ------
    ValueError
        If it has other bytes than were written, another shape, or axes or fixed parameters that are no numbers.
    """
    text = about.get("configuration")
    if not isinstance(text, str) or digest(text) != about.get("configuration_sha256"):
        raise ValueError
    try:
        configuration = json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(configuration, dict):
        raise ValueError("no object")
    axes, fixed = configuration.get("grid", {}), configuration.get("fixed", {})
    if not (isinstance(axes, dict) and isinstance(fixed, dict)):
        raise ValueError("grid and fixed must be objects")
    if not all(isinstance(values, list) and all(map(_is_number, values)) for values in axes.values()):
        raise ValueError("axes must be lists of numbers")
    if not all(map(_is_number, fixed.values())):
        raise ValueError("fixed parameters must be numbers")
    return configuration


def _is_number(value: Any) -> bool:
    """Return True for a number that is no bool."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _short(value: Any) -> str:
    """Return a value as messages show it: of a long list its number of values and both ends."""
    if isinstance(value, list) and len(value) > 4:
        return f"{len(value)} values from {value[0]!r} to {value[-1]!r}"
    return "nothing" if value is None else json.dumps(value)


def _flat(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration without nested mappings: the keys of these follow after a point, as in fixed.mu."""
    flat: dict[str, Any] = {}
    for key, value in configuration.items():
        nested = value if isinstance(value, Mapping) else {"": value}
        flat |= {f"{key}.{name}".rstrip("."): item for name, item in nested.items()}
    return flat


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return the differences of two configurations, one line for each key, such as ``periods: 200 -> 400``."""
    before, after = _flat(old), _flat(new)
    keys = [key for key in before | after if before.get(key) != after.get(key)]
    changes = []
    for key in keys:
        if key == "kernel_version":  # two hashes mean nothing to a reader
            changes.append("kernel_version: the sources of dimersweep are those of another version")
            continue
        was, now = _short(before.get(key)), _short(after.get(key))
        changes.append(f"{key}: {was} -> {now}" + (" (other values between)" if was == now else ""))
    if not changes and as_text(old) != as_text(new):
        changes.append(f"order: {', '.join(before)} -> {', '.join(after)}")
    return changes


def _git(*arguments: str) -> str | None:
    """Return the output of a git command in the folder of the program; None if it fails."""
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@cache
def _commit() -> dict[str, str]:
    """Return the attributes on the commit of the program, "unknown" for an installed copy; git is asked once in a process."""
    # an installed copy may lie inside somebody else's repository: ask for this very file first
    if _git("ls-files", "--error-unmatch", Path(__file__).name) is None:
        return {"git_commit": "unknown", "git_dirty": "unknown"}
    changes = _git("status", "--porcelain", "--", ".")
    return {"git_commit": _git("rev-parse", "HEAD") or "unknown", "git_dirty": "true" if changes else "false"}


@cache
def cpu() -> str:
    """Return the name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:  # not Linux
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def configured(configuration: Mapping[str, Any]) -> dict[str, str]:
    """Return a configuration as attributes: JSON and its sha256."""
    text = as_text(configuration)
    return {"configuration": text, "configuration_sha256": digest(text)}


def attributes(configuration: Mapping[str, Any], title: str, wall_time: float) -> dict[str, str | float]:
    """Return the global attributes of a cube.

    Parameters
    ----------
    configuration : mapping
        All settings that decide the numbers of the cube, as JSON can hold them.
    title : str
        Title of the cube.
    wall_time : float
        Duration of the sweep [s].

    Returns
    -------
    dict
        Strings and floats only, as NetCDF has no dict, None or bool.
    """
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {
        "Conventions": CONVENTIONS,
        "title": title,
        "source": SOURCE,
        "references": "Ratchet rotation of a 3D dimer on a vibrating plate",
        "history": f"{now} swept by dimersweep {__version__}",
        "dimersweep_cube": FILE_FORMAT,
        **configured(configuration),
        "kernel_version": kernel_version(),
        **_commit(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "llvmlite": version("llvmlite"),
        "cpu": cpu(),
        "platform": platform.platform(),
        "wall_time_s": wall_time,
    }


def check_attrs(attrs: Any) -> dict[str, Any]:
    """Return the attributes that a user gives a cube, if every format can hold them.

    Parameters
    ----------
    attrs : mapping of str to str, int, float or a list of numbers, optional
        The attributes; none by default.

    Raises
    ------
    ParameterError
        For a name that the program uses or that no file can have, and for a value of another type.
    """
    if not isinstance(attrs, Mapping | None):
        raise ParameterError(f"attrs = {reprlib.repr(attrs)}: must be a mapping of names to values")
    for name in attrs or {}:
        if not isinstance(name, str) or not ATTRIBUTE_NAME.fullmatch(name):
            raise ParameterError(f"attrs: {name!r:.60}: a name is a letter and at most 99 letters, digits, _, . or -")
        if name in OURS | _OF_LIBRARIES:
            raise ParameterError(f"attrs: {name}: is taken by the program or the file format; give another name")
    return {name: _attribute(name, value) for name, value in (attrs or {}).items()}


def _attribute(name: str, value: Any) -> str | int | float | np.ndarray:
    """Return the value of an attribute, checked; raise a ParameterError if it is not allowed."""
    shown = f"attrs: {name} = {reprlib.repr(value)}"
    if isinstance(value, str) and not _NO_TEXT.search(value):
        if name == "plot" and value not in get_args(Picture):
            raise ParameterError(f"{shown}: must be one of {', '.join(get_args(Picture))}")
        return value
    several = isinstance(value, list | tuple) or getattr(value, "ndim", 0) == 1
    try:
        if name in ("title", "plot") or (several and not len(value)):
            raise ParameterError
        return np.array([_number(name, each) for each in value]) if several else _number(name, value)
    except ParameterError:
        allowed = "a text" if name in ("title", "plot") else "a text, a finite number, or a list of such numbers"
        raise ParameterError(f"{shown}: must be {allowed}") from None


def _number(name: str, value: Any) -> int | float:
    """Return a finite number as int or float; raise a ParameterError for a text."""
    if isinstance(value, str):
        raise ParameterError
    number = as_number(name, value)
    return int(value) if isinstance(value, Integral) and abs(int(value)) < 2**63 else number
