"""Observers of a user's own: how they are declared, identified and found, and what they record of each run."""

import hashlib
import inspect
import json
import reprlib
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from dimersweep.cubes.results import MESSAGE_BYTES, OBSERVER_FAILED, RESULT, Along, Field
from dimersweep.errors import ParameterError, one_line, unknown
from dimersweep.inputs import as_number, as_numbers, check_count, check_switch
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.kernel.model.layout import CODE_N_EVENTS, CODE_N_PERIODS, CODE_STATUS, OK
from dimersweep.parameters import Parameters
from dimersweep.runs.recorded import named_state
from dimersweep.runs.run import as_run
from dimersweep.runs.solving import RunSettings, check_recorded, exactly, go_on, run_row
from dimersweep.studies.observers import MAX_NUMBERS, FinishedRuns, Observer
from dimersweep.symbols import PARAMETERS, QUANTITIES, SETTINGS, Quantity

DECLARED = "observer_declaration"  # attribute that `observer` sets on the function or class that it marks
WHY = Field("observer_error", QUANTITIES["observer_error"], f"S{MESSAGE_BYTES}", about="status")
CUT = b"..."  # ends a message that is longer than MESSAGE_BYTES
RECORDED = "a run that an observer looks at"

F = TypeVar("F")


class Declared(NamedTuple):
    """The declaration of an observer, as `observer` stores it.

    Attributes
    ----------
    variables : tuple of Field
        Variables that the observer records.
    code : str
        Its version, or the checksum of its text.
    depends : mapping of str to str
        Texts of the modules that it depends on, by their names.
    settles : bool
        True if a run that stopped when settled is enough for the observer.
    """

    variables: tuple[Field, ...]
    code: str
    depends: Mapping[str, str]
    settles: bool


# --- the declaration --------------------------------------------------------------------------------------------------


def observer(
    *,
    version: str | int | None = None,
    depends: Any = (),
    stop_when_settled: bool = False,
    **variables: Mapping[str, Any],
) -> Callable[[F], F]:
    """Declare the variables that a function records of each run of a sweep, ``sweep(..., observe=f)``.

    Observers are explained in docs/observers.md.

    Parameters
    ----------
    version : str or int, optional
        Version of the observer. By default a checksum of its file stands for the version.
    depends : sequence of str or module, optional
        Modules whose text counts for the checksum, too.
    stop_when_settled : bool
        If True, a run that stopped when its motion had settled is observed as it is; else its remaining periods are run
        first.
    **variables : mapping
        For each name that the function returns: `units` ("1" if none), `long_name`, and for a 1-D array `along`. This
        is a mapping with the `name` of the dimension, its `values` or their number, and optionally their `units` and
        `long_name`.

    Returns
    -------
    callable
        Decorator that marks a function, or a dataclass with ``__call__``, and returns it. The function is called with a
        `Run` and returns a mapping of names to numbers. Variables that it leaves out are missing (NaN).

    Raises
    ------
    ParameterError
        If a declaration has unknown or missing keys or values that are not allowed. If the marked object is neither a
        function nor a dataclass. If, without a `version`, the text of its file cannot be read, or several observers may
        share its line.

    Examples
    --------
    >>> from dimersweep import observer, sweep
    >>> @observer(lowest={"units": "rad", "long_name": "least dip angle in the last period"})
    ... def lowest_dip(run):
    ...     times = run.duration - np.linspace(0, 1, 50) / run.parameters["f"]
    ...     return {"lowest": run.states(times)["beta"].min()}
    >>> import numpy as np
    >>> cube = sweep({"Gamma": [0.6, 0.9]}, periods=60, observe=lowest_dip, progress=False)
    >>> cube["lowest"].attrs["units"], cube["lowest"].sizes
    ('rad', Frozen({'Gamma': 2}))
    """
    if not variables:
        raise ParameterError('observer: declares nothing; give names, such as peak={"units": "Hz", "long_name": "..."}')
    if not isinstance(version, str | int | None):
        raise ParameterError(f"observer: version = {reprlib.repr(version)}: must be a text or a whole number")
    if version is not None and depends:
        raise ParameterError("observer: version: stands in place of the text of all files; give it without depends")
    settles = check_switch("observer: stop_when_settled", stop_when_settled)
    declared = tuple(_field(name, declaration) for name, declaration in variables.items())
    modules = map(_module, depends if isinstance(depends, list | tuple) else [depends])
    texts = {each.__name__: _text_of(each) for each in modules}

    def mark(function: F) -> F:
        if not isinstance(function, FunctionType | type):
            raise ParameterError(f"observer: marks a function or a dataclass, and no {type(function).__name__}")
        code = _checksum(function, sys._getframe(1).f_code, declared, texts) if version is None else str(version)
        setattr(function, DECLARED, Declared(declared, code, texts, settles))
        return function

    return mark


def _field(name: str, declaration: Any) -> Field:
    """Return a variable, as it was declared, as a field of the cube; raise a ParameterError if it is not allowed."""
    _check_name(name)
    units, meaning, along = _declared(f"observer: {name}", declaration, ("units", "long_name"), ("along",))
    if along is None:
        return Field(name, Quantity(units, meaning))
    dim, values, its_units, its_meaning = _declared(
        f"observer: {name}.along", along, ("name", "values"), ("units", "long_name")
    )
    _check_name(dim)
    if dim == name:  # the cube would have its coordinate there
        raise ParameterError(f"observer: {name}.along.name = {dim!r}: must be another name than that of the variable")
    where = f"observer: {name}.along.values"
    unit = its_units or "1"
    values = np.arange(check_count(where, values)) if isinstance(values, int) else as_numbers(where, values, unit)
    label = Quantity(unit, its_meaning or f"number of the {dim}")
    return Field(name, Quantity(units, meaning), along=Along(dim, np.atleast_1d(values), label))


def _check_name(name: str) -> None:
    """Raise a ParameterError if `name` is no name of ASCII letters, digits and underscores."""
    if not name.isidentifier() or not name.isascii():
        raise ParameterError(f"observer: {name!r}: must be a name of letters, digits and _")


def _declared(where: str, mapping: Any, needed: tuple[str, ...], more: tuple[str, ...]) -> list[Any]:
    """Return the values of a mapping for the keys `needed` and `more`, None for those of `more` that are missing."""
    if not isinstance(mapping, Mapping):
        raise ParameterError(f"{where} = {reprlib.repr(mapping)}: must be a mapping with {' and '.join(needed)}")
    for key in mapping:
        if key not in (*needed, *more):
            raise ParameterError(f"{where}.{unknown(key, 'key', (*needed, *more))}")
    for key in needed:
        if key not in mapping:
            raise ParameterError(f"{where}.{key}: is missing")
    for key, value in mapping.items():
        if key not in ("along", "values") and not (isinstance(value, str) and value):
            raise ParameterError(f"{where}.{key} = {reprlib.repr(value)}: must be a text")
    return [mapping.get(key) for key in (*needed, *more)]


# --- the checksum -----------------------------------------------------------------------------------------------------


def _checksum(function: Any, caller: CodeType, *parts: Any) -> str:
    """Return the checksum of an observer: of the text of its file, of its line there, and of `parts`.

    `caller` is the code that marks the observer. A decorator may stand in another file, whose text counts then, too.
    The text is taken when the file is imported, as it may have changed later on.

    Raises
    ------
    ParameterError
        If the text cannot be read, or one line of it may make several observers (a lambda, a function in a function).
    """
    if "<" in function.__qualname__:  # <lambda>, or in the <locals> of a function
        raise ParameterError(
            f"observer: {function.__qualname__}: must be defined by its name, outside of all functions; else give version="
        )
    call = inspect.unwrap(vars(function).get("__call__", function) if isinstance(function, type) else function)
    code = getattr(call, "__code__", caller)
    parts = (_text_of(caller), _text_of(code), code.co_firstlineno, *parts)
    # 16 digits, or 64 bits: no two texts share them by chance
    return "text " + hashlib.sha256(json.dumps(parts, default=np.ndarray.tolist).encode()).hexdigest()[:16]


def _text_of(what: CodeType | ModuleType) -> str:
    """Return the whole text of the file, or of the cell of a notebook, in which code stands."""
    try:
        return "".join(inspect.findsource(what)[0])
    except (OSError, TypeError):
        name = what.__name__ if isinstance(what, ModuleType) else what.co_filename
        cure = "give version=, and change it with the code"
        raise ParameterError(f"observer: the text of {name} cannot be read; {cure}") from None


def _module(given: str | ModuleType) -> Any:
    """Return a module that an observer depends on; refuse a package, whose text lies in many files."""
    there = _imported(given, f"observer: depends = {given!r}") if isinstance(given, str) else given
    if not isinstance(there, ModuleType) or hasattr(there, "__path__"):
        raise ParameterError(
            f"observer: depends = {given!r}: must be modules or their names, and of a package those in it"
        )
    return there


# --- finding an observer ----------------------------------------------------------------------------------------------


def look_in(folder: Path) -> None:
    """Add a folder to the places where modules are searched for, behind all others, to find observers there."""
    if str(folder.absolute()) not in sys.path:
        sys.path.append(str(folder.absolute()))


def found(name: str) -> Any:
    """Return the object that has a name such as ``my_module:spectral``.

    Raises
    ------
    ParameterError
        If the module does not exist, cannot be imported, or has no object of that name.
    """
    module, _, path = name.partition(":")
    if not module or not path:
        raise ParameterError(f"observe = {name!r}: must be a module and a name in it, such as 'my_module:spectral'")
    there = _imported(module, f"observe = {name!r}")
    for part in path.split("."):
        if not hasattr(there, part):
            raise ParameterError(f"observe = {name!r}: {module} has no {part}")
        there = getattr(there, part)
    return there


def _imported(module: str, where: str) -> Any:
    """Import a module and return it; raise a ParameterError that begins with `where` if the import fails."""
    try:
        return import_module(module)
    except Exception as error:  # whatever the module does
        why = f"{module} cannot be imported ({type(error).__name__}: {one_line(error)})"
        if isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}."):
            why = f"there is no module {error.name}"
        raise ParameterError(f"{where}: {why}") from None


def _shown(given: Any) -> str:
    """Return the name of an observer for messages."""
    return getattr(given, "__qualname__", None) or reprlib.repr(given)


def _taken_apart(given: Any) -> tuple[Any, dict[str, Any]]:
    """Return the function or dataclass that was declared as an observer, and its arguments by name.

    Raises
    ------
    ParameterError
        If `given` was not declared, or has arguments that no configuration (JSON) can hold.
    """
    arguments: dict[str, Any] = {}
    while isinstance(given, partial):
        if given.args:
            raise ParameterError(f"observe = {_shown(given.func)}: give its arguments by name")
        given, arguments = given.func, given.keywords | arguments
    if is_dataclass(given) and not isinstance(given, type):
        given, arguments = type(given), {each.name: getattr(given, each.name) for each in fields(given)}
    shown = f"observe = {_shown(given)}"
    declared = getattr(given, "__dict__", {}).get(DECLARED)
    # a declaration that is inherited, or copied from a wrapped function, has the checksum of another text
    if declared is None or declared is getattr(getattr(given, "__wrapped__", None), DECLARED, None):
        cure = '@dimersweep.observer(name={"units": ..., "long_name": ...})'
        raise ParameterError(f"{shown}: declares nothing; mark a function or a dataclass, above all else, with {cure}")
    if isinstance(given, type) and not (is_dataclass(given) and "__call__" in vars(given)):
        raise ParameterError(f"{shown}: must be a dataclass with a __call__")
    for name, value in arguments.items():
        try:
            alike = json.loads(json.dumps(value, allow_nan=False)) == value
        except (TypeError, ValueError):
            alike = False
        if not alike:
            allowed = "a number, a text, a switch, or a list or mapping of these"
            raise ParameterError(f"observe: argument {name} = {reprlib.repr(value)}: must be {allowed}")
    return given, arguments


# --- observing a run --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class OwnObserver(Observer):
    """An observer of a user's own: a function of a run that returns a mapping of names to numbers.

    Parameters
    ----------
    name : str
        Where the observer stands, such as ``my_module:spectral``.
    arguments : dict
        Arguments of the observer besides the run, by name.
    code : str
        Version or checksum, see `Declared`.
    declared : tuple of Field
        Variables that it records.
    how : RunSettings
        Settings of the runs that it observes. Without `stop_when_settled`, a run of the study that stopped early is
        continued.
    base : function or class, optional
        The object of that name; None in another process, which imports it by `name`.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"record"})

    name: str
    arguments: dict[str, Any]
    code: str
    declared: tuple[Field, ...]
    how: RunSettings
    base: Any

    @property
    def fields(self) -> tuple[Field, ...]:
        """Fields that are filled in: the declared variables, and the error of an observer that failed."""
        return (*self.declared, WHY)

    def settings(self) -> dict[str, Any]:
        """Return the name, version, arguments and variables of the observer, for the configuration."""
        names = [name for each in self.declared for name in (each.name, *([each.along.name] if each.along else []))]
        return {"observe": {"name": self.name, "code": self.code, "arguments": self.arguments, "variables": names}}

    def __getstate__(self) -> dict[str, Any]:
        """Leave the function out where other processes can import it by name: they report then what they lack."""
        try:
            known = not self.name.startswith("__main__:") and found(self.name) is self.base
        except ParameterError:
            known = False
        return vars(self) | ({"base": None} if known else {})

    @property
    def here(self) -> Any:
        """The function or class of the observer; imported by its name where it was left out (`__getstate__`)."""
        return found(self.name) if self.base is None else self.base

    def check_here(self) -> None:
        """Refuse another version of the observer in this process (ParameterError).

        Modules that the observer depends on must be unchanged, too, since they were imported.
        """
        try:
            there = found(self.name)
        except ParameterError:
            there = self.here  # an observer without an importable name goes to other processes as a copy
        declaration = getattr(there, DECLARED, getattr(self.base, DECLARED, None))
        if (
            declaration is None
            or declaration.code != self.code
            or any(_text_of(_module(name)) != text for name, text in declaration.depends.items())
        ):
            raise ParameterError(
                f"observe = {self.name!r}: is another version here; import all of it anew, and give all workers the same files"
            )

    def failed(self, result: np.void, error: Exception) -> None:
        """Record in the result of a point that the observer raised `error` there; other points are not affected."""
        why = f"{type(error).__name__}: {one_line(error)}".encode(errors="backslashreplace")
        if len(why) > MESSAGE_BYTES:
            why = why[: MESSAGE_BYTES - len(CUT)].decode(errors="ignore").encode() + CUT
        result[WHY.name] = why
        result["codes"][CODE_STATUS] = OBSERVER_FAILED

    def observe(self, runs: FinishedRuns, space: Workspace) -> None:
        """Run the observer on each run that is ok, continue the run first where needed, and record its variables."""
        how, here = self.how, self.here
        call = here(**self.arguments) if isinstance(here, type) else partial(here, **self.arguments)
        for row, result in zip(runs.rows, runs.results, strict=True):
            if result["codes"][CODE_STATUS] != OK:
                continue
            solved = runs.solved or run_row(row, None, how, space, record=True)
            start = None if solved.start is None else named_state(row, solved.start)
            if not how.stop_when_settled and solved.codes[CODE_N_PERIODS] < how.periods and not is_stopped(space):
                whole, events = exactly(how.periods, how.rtol), int(solved.codes[CODE_N_EVENTS])
                solved = go_on(row, solved.end, events, solved.record, whole, space)
            if is_stopped(space):
                return
            run = as_run(Parameters(**runs.given or {}).given(), how.rtol, solved, start)
            try:
                if run.status != "ok":
                    raise RuntimeError(f"after it had settled, the run ended in period {run.n_periods}: {run.message}")
                for name, values in self._checked(call(run)).items():
                    result[name] = values
            except MemoryError:
                raise
            except Exception as error:
                self.failed(result, error)

    def _checked(self, returned: Any) -> dict[str, np.ndarray]:
        """Return what an observer returned as arrays by name; raise an error if it differs from the declaration."""
        if not isinstance(returned, Mapping):
            raise TypeError(f"returned {type(returned).__name__}, no mapping of names to numbers")
        fields = {each.name: each for each in self.declared}
        values = {}
        for name, value in returned.items():
            if name not in fields:
                raise ValueError(unknown(name, "variable", fields))
            shape, units = fields[name].shape, fields[name].quantity.units
            if np.shape(value) != shape:
                raise ValueError(f"{name}: has shape {np.shape(value)}, and {shape} was declared")
            read = as_numbers if shape else as_number
            values[name] = np.asarray(read(name, value, units, result=True))
        return values


def own_of(
    observe: Any,
    points: int,
    how: RunSettings,
    *,
    others: Iterable[Observer] = (),
    axes: Iterable[str] = (),
    arguments: Mapping[str, Any] | None = None,
) -> tuple[OwnObserver, ...]:
    """Return the observer that a user gives, checked, in a tuple; an empty tuple for None.

    Parameters
    ----------
    observe : callable or str, optional
        Function or dataclass that `observer` has marked; or its place, such as ``my_module:spectral``.
    points : int
        Number of points of the study.
    how : RunSettings
        Settings of the runs that it observes.
    others : iterable of Observer
        Other observers of the study, whose names are taken.
    axes : iterable of str
        Dimensions of the cube, whose names are taken.
    arguments : mapping, optional
        Arguments of the observer besides the run, by name.

    Raises
    ------
    ParameterError
        If the observer is not found, was not declared, takes other arguments, has names that the cube has already, or
        records more numbers than one cube may hold.
    """
    if observe is None:
        if arguments:
            raise ParameterError("observe_with: is for an observer; give observe")
        return ()
    given = found(observe) if isinstance(observe, str) else observe
    if isinstance(given, type) or arguments:
        try:
            given = given(**arguments or {}) if isinstance(given, type) else partial(given, **arguments or {})
        except TypeError as error:
            raise ParameterError(f"observe = {observe!r}: {one_line(error)}") from None
    base, known = _taken_apart(given)
    check_recorded(how.max_periods, RECORDED)
    declared, code, _, settles = getattr(base, DECLARED)
    how = how._replace(stop_when_settled=how.stop_when_settled and settles)
    _check_names(declared, [each for other in others for each in other.fields], axes)
    numbers = sum(each.size for each in declared if each.along)
    if points * numbers > MAX_NUMBERS:
        raise ParameterError(
            f"observe: {points} points with {numbers} numbers in arrays; one cube may hold {MAX_NUMBERS} of them"
        )
    name = f"{base.__module__}:{base.__qualname__}"
    return (OwnObserver(name, known, code, declared, how, base),)


def _check_names(declared: Iterable[Field], others: Iterable[Field], axes: Iterable[str]) -> None:
    """Refuse names that the cube has already, and one dimension with different values (ParameterError)."""
    others = list(others)
    dims = {each.along.name: each.along.values for each in others if each.along}
    taken = {*PARAMETERS, *QUANTITIES, *SETTINGS, *(RESULT.names or ()), *axes, *(each.name for each in others)}
    for each in declared:
        along = each.along
        for name in (each.name, *([along.name] if along else [])):
            if name in taken or (name == each.name and name in dims):
                raise ParameterError(f"observe: {name}: is a name that the cube has; give another one")
        if along and not np.array_equal(dims.setdefault(along.name, along.values), along.values):
            raise ParameterError(f"observe: {along.name}: is a dimension with other values, too; give it another name")
        taken.add(each.name)
