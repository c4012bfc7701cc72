"""Read sweep files (TOML), check them, and make studies and cubes of them; write a declaration from a cube."""

import json
import os
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Unpack, get_args

import xarray as xr
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from dimersweep.cubes.grid import axis_values, fixed_value, without_directions
from dimersweep.errors import ParameterError, StoreError, one_line, unknown
from dimersweep.inputs import check_count, check_rtol, read_toml
from dimersweep.parameters import check, spelt_out
from dimersweep.storage.checking import check_configured
from dimersweep.storage.cubefiles import open_cube
from dimersweep.storage.outputs import check_ending
from dimersweep.storage.provenance import PART, differences
from dimersweep.studies import refine, search, sweep
from dimersweep.studies.making import make_cube
from dimersweep.studies.observing import look_in
from dimersweep.studies.point_tables import point_table
from dimersweep.studies.study import Study
from dimersweep.symbols import PARAMETERS, Picture
from dimersweep.work.options import MakingKeywords

# attributes of a cube that name the program, the compiler and the processor that made it
MADE_BY = ("source", "git_commit", "python", "numpy", "numba", "llvmlite", "cpu")


class SweepFileSection(BaseModel):
    """A section of a TOML file, which refuses unknown keys and values of another type."""

    model_config = ConfigDict(extra="forbid", strict=True)


class SweepSection(SweepFileSection):
    """The section ``[sweep]``: settings of the runs, and the output."""

    title: str | None = None
    periods: Annotated[int, AfterValidator(partial(check_count, "sweep.periods"))]
    max_periods: int | None = None
    rtol: Annotated[float, AfterValidator(check_rtol)] = 1e-8
    stop_when_settled: bool = True
    certify: bool = False
    strobes: int = 0
    carry: Literal["up", "down", "both"] | None = None
    sustained: bool = False
    observe: str | None = None
    observe_with: dict[str, Any] = Field(default_factory=dict)
    output: Annotated[str, AfterValidator(partial(check_ending, name="sweep.output"))]


class PointsSection(SweepFileSection):
    """The section ``[points]``: single points in place of a grid, from a file, listed, or drawn from ranges."""

    file: str | None = None
    columns: dict[str, Any] = Field(default_factory=dict)
    ranges: dict[str, Any] = Field(default_factory=dict)
    sample: Literal["random", "latin_hypercube", "sobol"] | None = None
    number: int | None = None
    seed: int | None = None


class SearchSection(SweepFileSection):
    """The section ``[search]``: a question about one axis, in place of a run at each of its values."""

    over: str
    ask: Literal["any", "all", "first", "fraction"] = "any"
    mode: str = "drift"
    orbit_periods: int = 0


class RefineSection(SweepFileSection):
    """The section ``[refine]``: the number of halvings of each axis, and the regions whose borders are refined."""

    halvings: dict[str, int]
    between: list[str] | None = None


class PathsSection(SweepFileSection):
    """The section ``[paths]``: length and density of the path of the centre of mass that each run keeps."""

    periods: int
    per_period: int = 8


class PlotSection(SweepFileSection):
    """The section ``[plot]``: the kind of picture of the cube."""

    kind: Picture | None = None


class Declaration(SweepFileSection):
    """A sweep, search or refined map, as a file declares it."""

    sweep: SweepSection
    grid: dict[str, Any] | None = None
    points: PointsSection | None = None
    fixed: dict[str, Any] = Field(default_factory=dict)
    search: SearchSection | None = None
    refine: RefineSection | None = None
    paths: PathsSection | None = None
    plot: PlotSection = Field(default_factory=PlotSection)

    def study(
        self,
        *,
        periods: int | None = None,
        rtol: float | None = None,
        certify: bool = False,
        carry: str | None = None,
        observe: Any = None,
    ) -> Study:
        """Return the study that the sections declare together, checked.

        Parameters
        ----------
        periods, rtol : int, float, optional
            Settings in place of the declared ones. `periods` removes the declared ``max_periods``, too.
        certify : bool
            True to certify a sweep that is not declared to be certified, see `sweep`.
        carry : str, optional
            Direction in place of the declared one.
        observe : callable or str, optional
            Observer in place of the declared one and its arguments.

        Raises
        ------
        ParameterError
            If sections do not go together, or a setting is not allowed.
        """
        given: dict[str, Any] = {
            "periods": self.sweep.periods if periods is None else periods,
            "max_periods": self.sweep.max_periods if periods is None else None,
            "rtol": self.sweep.rtol if rtol is None else rtol,
            "observe": observe or self.sweep.observe,
            "observe_with": None if observe else self.sweep.observe_with,
        }
        certify, carry = certify or self.sweep.certify, carry or self.sweep.carry
        if self.grid is None and self.points is None:
            raise ParameterError("grid: is missing; or give points")
        if self.search is None:
            if self.refine or self.paths:
                raise ParameterError("search: is missing; refine and paths go with a search")
            given |= {"stop_when_settled": self.sweep.stop_when_settled, "certify": certify}
            given |= {"strobes": self.sweep.strobes, "carry": carry, "sustained": self.sweep.sustained}
            points = None if self.points is None else point_table(**self.points.model_dump())
            return sweep.study_of(self.grid, self.fixed, points=points, **given)
        if self.points or self.grid is None:
            raise ParameterError("points: is for sweeps; a search has a grid")
        whole = "is for sweeps of a whole grid"
        for is_given, refusal in (
            (self.sweep.strobes, f"sweep.strobes = {self.sweep.strobes}: {whole}"),
            (self.sweep.sustained, f"sweep.sustained = true: {whole}"),
            (carry, f"carry = {carry!r}: {whole}; a search starts each run by itself"),
            (certify, f"certify: {whole}; a search does not take it"),
            (
                not self.sweep.stop_when_settled,
                "sweep.stop_when_settled = false: a search stops each run that has settled",
            ),
        ):
            if is_given:
                raise ParameterError(refusal)
        paths = None if self.paths is None else self.paths.model_dump()
        question = search.study_of(self.grid, self.fixed, paths=paths, **self.search.model_dump(), **given)
        return question if self.refine is None else refine.study_of(question, **self.refine.model_dump())

    @property
    def attrs(self) -> dict[str, str]:
        """Global attributes of the cube: the title, if any, and the kind of picture."""
        plot = self.plot.kind or ("circles" if self.sweep.sustained else "mode_map")
        return ({} if self.sweep.title is None else {"title": self.sweep.title}) | {"plot": plot}


def explain(error: ValidationError, whole: type[BaseModel]) -> list[str]:
    """Return the complaints of pydantic about a file, each in one line with the key and what is allowed.

    `whole` is the type of the whole file.
    """
    mistakes: list[str] = []
    meant: set[str] = set()
    for complaint in error.errors():
        *section, key = (str(part) for part in complaint["loc"])
        where = ".".join([*section, key])
        if complaint["type"] == "extra_forbidden":
            within = whole
            for name in section:
                kinds = (within.model_fields[name].annotation, *get_args(within.model_fields[name].annotation))
                within = next(kind for kind in kinds if hasattr(kind, "model_fields"))
            line = unknown(key, "key", within.model_fields)
            mistakes.append(".".join([*section, line]))
            meant.update(".".join([*section, name]) for name in re.findall(r"did you mean (\w+)\?", line))
        elif complaint["type"] == "missing":
            mistakes.append(f"{where}: is missing")
        elif complaint["type"] == "value_error":
            mistakes.append(str(complaint["ctx"]["error"]))  # a ParameterError, which names the parameter itself
        else:
            mistakes.append(f"{where} = {complaint['input']!r}: {complaint['msg'].replace('Input should', 'must')}")
    # a key that was misspelt is not reported as missing, too
    return [line for line in mistakes if line.partition(": is missing")[0] not in meant]


def _of_parameters(raw: Mapping[str, Any]) -> list[str]:
    """Return the mistakes in single parameters of the sections grid and fixed, each in one line."""
    mistakes = []
    sections = {name: given for name in ("grid", "fixed") if isinstance(given := raw.get(name, {}), Mapping)}
    try:
        fixed = spelt_out(sections.get("fixed", {}), dict.fromkeys(sections.get("grid", ())))
    except ParameterError as error:
        return [str(error)]
    for given, read in ((sections.get("grid", {}), axis_values), (fixed, fixed_value)):
        for name, value in given.items():
            try:
                check({name: read(name, value)}, gaps=PARAMETERS)  # rules between two parameters wait for all of them
            except ParameterError as error:
                mistakes.append(str(error))
    return mistakes


M = TypeVar("M", bound=BaseModel)


def read_sections(
    path: Path,
    whole: type[M],
    check_whole: Callable[[M], object],
    piecewise: Callable[[Any], list[str]] = lambda raw: [],
) -> M:
    """Read a TOML file, check its sections one by one and then together, and return it as an object of type `whole`.

    Parameters
    ----------
    path : Path
        The file, TOML.
    whole : type
        Type of the file: a model with a field for each section.
    check_whole : callable
        Raises a ParameterError if sections that are allowed one by one do not go together.
    piecewise : callable
        Returns further mistakes in single values of the parsed file, each in one line.

    Raises
    ------
    ParameterError
        If the file cannot be read, or has mistakes. All mistakes in single values are listed, a line for each.
    """
    raw = read_toml(path)
    mistakes = []
    try:
        declared = whole.model_validate(raw)
    except ValidationError as error:
        mistakes = explain(error, whole)
    mistakes += piecewise(raw)
    if not mistakes:
        try:
            check_whole(declared)
            return declared
        except ParameterError as error:
            mistakes = [str(error)]
    if len(mistakes) > 1:
        raise ParameterError(f"{path}: {len(mistakes)} mistakes" + "".join(f"\n  {line}" for line in mistakes))
    raise ParameterError(f"{path}: {mistakes[0]}")


def read_declaration(path: str | os.PathLike[str]) -> Declaration:
    """Read and check a sweep file.

    Parameters
    ----------
    path : path-like
        TOML with the sections ``[sweep]``, ``[grid]`` or ``[points]``, and optionally ``[fixed]``, ``[search]``,
        ``[refine]``, ``[paths]`` and ``[plot]``. A file of points and the module of an observer are searched for in the
        folder of the sweep file.

    Returns
    -------
    Declaration

    Raises
    ------
    ParameterError
        If the file has mistakes; the message names the file, every wrong key, and what is allowed.

    Examples
    --------
    >>> from pathlib import Path
    >>> from dimersweep import read_declaration
    >>> from dimersweep.studies.presets import find_declaration
    >>> declared = read_declaration(find_declaration(Path("fig07-small")))
    >>> declared.sweep.periods, declared.grid["f"]
    (200, [15, 20, 25])
    """
    path = Path(path)

    def check_whole(declared: Declaration) -> None:
        if declared.points is not None and declared.points.file is not None:
            declared.points.file = str(path.parent / declared.points.file)
        look_in(path.parent)
        declared.study()

    return read_sections(path, Declaration, check_whole, _of_parameters)


def make(
    declared: Declaration,
    out: str | os.PathLike[str] | None,
    *,
    periods: int | None = None,
    rtol: float | None = None,
    certify: bool = False,
    observe: Any = None,
    **options: Unpack[MakingKeywords],
) -> xr.Dataset:
    """Make the cube of a declaration, and write it.

    Parameters
    ----------
    declared : Declaration
        The declaration.
    out : path-like, optional
        File of the cube.
    periods, rtol : int, float, optional
        Settings in place of the declared ones.
    certify : bool
        As in `sweep`; a search cannot be certified.
    observe : callable or str, optional
        Observer in place of the declared one, as in `sweep`.
    **options
        As in `sweep`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    ParameterError, StoreError, PointError, UnfinishedError, Stopped
        As by `sweep`.

    Examples
    --------
    >>> from pathlib import Path
    >>> from dimersweep import make, read_declaration
    >>> from dimersweep.studies.presets import find_declaration
    >>> declared = read_declaration(find_declaration(Path("fig07-small")))
    >>> cube = make(declared, "small.nc", periods=60, progress=False, force=True)
    >>> dict(cube.sizes)
    {'f': 3, 'beta0': 44}
    """
    study = declared.study(periods=periods, rtol=rtol, certify=certify, observe=observe)
    options.setdefault("attrs", declared.attrs)
    return make_cube(study, out=out, **options)


def from_cube(path: str | os.PathLike[str], *, other_kernel: bool = False) -> Declaration:
    """Return the declaration that makes the cube at `path` again; of the cube of a part, that of the whole sweep.

    Parameters
    ----------
    path : path-like
        The cube.
    other_kernel : bool
        If True, a cube of another kernel version is accepted, though its numbers may differ in the last digits.

    Returns
    -------
    Declaration

    Raises
    ------
    StoreError
        If there is no such cube, its points were changed, or its configuration is unknown to this version. Without
        `other_kernel` also if another kernel made it; the message names the versions that did.
    """
    cube = open_cube(path)
    check_configured(cube, path)
    configuration = json.loads(cube.attrs["configuration"])
    configuration.pop(PART, None)
    try:
        declaration = _declared(cube, configuration, path)
    except (KeyError, TypeError, ValueError, AttributeError) as error:  # a ValidationError is a ValueError
        raise StoreError(f"{path}: tells a configuration that this version does not know ({one_line(error)})") from None
    changes = differences(configuration, declaration.study().configuration())
    if changes and not other_kernel:
        made_by = ", ".join(f"{name} {cube.attrs.get(name, 'unknown')}" for name in MADE_BY)
        raise StoreError(
            f"{path}: was made by another version, so its numbers may differ in the last digits; install that one "
            f"({made_by}), or go on with other_kernel=True. What differs:" + "".join(f"\n  {line}" for line in changes)
        )
    return declaration


def _declared(cube: xr.Dataset, configuration: Mapping[str, Any], path: str | os.PathLike[str]) -> Declaration:
    """Return the declaration of a sweep, a search or a refined map with this configuration."""
    sweep: dict[str, Any] = {name: configuration[name] for name in ("periods", "rtol")}
    sweep |= {"title": cube.attrs["title"], "max_periods": configuration.get("max_periods"), "output": str(path)}
    if "observe" in configuration:
        look_in(Path(path).parent)
        sweep |= {"observe": configuration["observe"]["name"], "observe_with": configuration["observe"]["arguments"]}
    given: dict[str, Any] = {"fixed": configuration["fixed"], "plot": {"kind": cube.attrs.get("plot", "mode_map")}}
    if "search" in configuration:
        asked = dict(configuration["search"])
        over, values = asked.pop("axis"), asked.pop("values")
        given |= {"grid": configuration["grid"] | {over: values}, "search": asked | {"over": over}}
        given |= {name: configuration[name] for name in ("refine", "paths") if name in configuration}
    else:
        sweep["stop_when_settled"] = configuration["stop_when_settled"]
        sweep |= {name: configuration[name] for name in ("certify", "strobes", "sustained") if name in configuration}
        given["grid"], sweep["carry"] = without_directions(configuration.get("grid"))
        given |= {"points": {"columns": configuration["points"]}} if "points" in configuration else {}
    return Declaration.model_validate(given | {"sweep": sweep})
