"""What tells code from other code, in memory: a hash of a function or a class with all that it names."""

import hashlib
import json
from collections.abc import Mapping
from inspect import getsource
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np


def code_of(what: Any, declared: Any) -> str:
    """The sha256 of what a function or a class does and declares: its code, and what that names of its module.

    Of functions of other modules their own code counts; of a module its version, or its text if it has none. The code is that
    in memory, which runs: a file may have changed since.
    """
    parts = {"declared": _tell(declared, "", {})}
    _tell(what, what.__module__, parts)
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _tell(value: Any, home: str, parts: dict[str, Any]) -> Any:
    """What stands for something that code may name, alike in every process; functions and classes go into `parts`."""
    value = getattr(value, "py_func", value)  # of a compiled one
    if isinstance(value, FunctionType | type):
        name = f"{value.__module__}:{value.__qualname__}"
        if name not in parts:
            parts[name] = None  # it may name itself
            parts[name] = _told_class(value, home, parts) if isinstance(value, type) else _told(value, home, parts)
        return name
    if isinstance(value, ModuleType):
        return getattr(value, "__version__", None) or _text_of(value)
    if isinstance(value, np.ndarray):
        return [str(value.dtype), value.shape, value.tobytes().hex()]
    if isinstance(value, list | tuple):
        return [_tell(each, home, parts) for each in value]
    if isinstance(value, set | frozenset):
        return sorted(map(repr, value))
    if isinstance(value, Mapping):
        return [[_tell(each, home, parts) for each in pair] for pair in value.items()]
    is_plain = isinstance(value, int | float | complex | str | bytes | None) or value is Ellipsis
    return repr(value) if is_plain else type(value).__qualname__


def _told(function: FunctionType, home: str, parts: dict[str, Any]) -> list[Any]:
    """The code of a function and its defaults; with what it names, if it is at home."""
    code = function.__code__
    told = [_plain_code(code), _tell([function.__defaults__, function.__kwdefaults__], home, parts)]
    if function.__module__ == home:
        kept = zip(code.co_freevars, function.__closure__ or (), strict=True)
        known = function.__globals__ | {name: cell.cell_contents for name, cell in kept}
        told += [[name, _tell(known[name], home, parts)] for name in sorted(_names_in(code)) if name in known]
    return told


def _told_class(kind: type, home: str, parts: dict[str, Any]) -> list[Any]:
    """The functions and the values of a class that is at home."""
    told = []
    for name, value in sorted(vars(kind).items()) if kind.__module__ == home else ():
        inner = getattr(value, "__func__", None) or getattr(value, "fget", None) or value
        if isinstance(inner, FunctionType) or not name.startswith("__"):
            told.append([name, _tell(inner, home, parts)])
    return told


def _plain_code(code: CodeType) -> list[Any]:
    """What code does, without where it stands."""
    constants = [_plain_code(each) if isinstance(each, CodeType) else _tell(each, "", {}) for each in code.co_consts]
    names = [code.co_names, code.co_varnames, code.co_freevars, code.co_argcount, code.co_flags]
    return [code.co_code.hex(), getattr(code, "co_exceptiontable", b"").hex(), *names, constants]


def _names_in(code: CodeType) -> set[str]:
    inner = (_names_in(each) for each in code.co_consts if isinstance(each, CodeType))
    return {*code.co_names, *code.co_freevars}.union(*inner)


def _text_of(module: ModuleType) -> str:
    try:
        return getsource(module)
    except (OSError, TypeError):  # built in
        return module.__name__
