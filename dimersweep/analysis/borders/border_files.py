"""Read files that declare borders, branches or families, make their tables part by part, and label them as cubes."""

import os
import signal
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import product
from math import prod
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import numpy as np
import xarray as xr
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict

from dimersweep.analysis.orbits.borders.border_grid import border
from dimersweep.analysis.orbits.continuation.following import follow
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS, kind_words
from dimersweep.analysis.orbits.map.finding import checked, checked_spin, find, units_along
from dimersweep.analysis.orbits.slow.families import family, spin_range
from dimersweep.cubes.cube import column, finished
from dimersweep.cubes.grid import axis_values, evenly, fixed_value
from dimersweep.errors import OrbitError, ParameterError, Stopped, unknown
from dimersweep.extensions import ORBITS_CODE
from dimersweep.inputs import as_number, check_count
from dimersweep.kernel import kernel_version
from dimersweep.parameters import check_name, spelt_out, value_of
from dimersweep.storage.cubefiles import write_cube
from dimersweep.storage.files import delete, disk_errors
from dimersweep.storage.formats.netcdf import read_netcdf, write_netcdf
from dimersweep.storage.outputs import TABLES, check_ending, check_output
from dimersweep.storage.provenance import attributes
from dimersweep.storage.store import Store, StoredTile, finished_at, opened_store
from dimersweep.studies.declared import read_sections
from dimersweep.symbols import PARAMETERS, START, Quantity
from dimersweep.work.computing import prepare_kernel

Tell = Callable[[str], None]
Maker = Callable[[Tell], xr.Dataset]


class BorderFileSection(BaseModel):
    """A section of a file of borders, which refuses unknown keys."""

    model_config = ConfigDict(extra="forbid")


def _distinct(name: str, values: list[Any]) -> list[Any]:
    """Return `values` unchanged; raise a ParameterError if there are none, or a value comes twice."""
    if not values:
        raise ParameterError(f"{name} = []: must have at least one")
    for value in values:
        if values.count(value) > 1:
            raise ParameterError(f"{name}: {value} is there twice")
    return values


Spin = Annotated[float, BeforeValidator(partial(as_number, "spin", units="rad s-1"))]


class Head(BorderFileSection):
    """The section ``[borders]``: title and output."""

    title: str
    output: Annotated[str, AfterValidator(partial(check_ending, name="borders.output", what="a table", endings=TABLES))]


class Curves(BorderFileSection):
    """The section ``[curves]``: borders in one parameter over the axes in `over`; curves run along the last axis."""

    kinds: Annotated[list[str], AfterValidator(partial(_distinct, "curves.kinds"))]
    parameter: str = "Gamma"
    spin: Spin | None = None


class Branches(BorderFileSection):
    """The section ``[branches]``: branches in one parameter from the orbit at each point of `over` to `ends`."""

    parameter: str
    ends: list[Any]
    spin: Spin | None = None
    switch: bool = False
    words: bool = True
    points: Annotated[int, AfterValidator(partial(check_count, "branches.points"))] = 200


class Families(BorderFileSection):
    """The section ``[families]``: orbits at spins evenly spread over a range, at each point of `over`."""

    spin: tuple[Spin, Spin]
    points: Annotated[int, AfterValidator(partial(check_count, "families.points"))] = 50


class Borders(BorderFileSection):
    """A file of borders: exactly one of `curves`, `branches` and `families`, with axes and fixed parameters."""

    borders: Head
    curves: Curves | None = None
    branches: Branches | None = None
    families: Families | None = None
    over: dict[str, Any] = {}
    fixed: dict[str, Any] = {}

    @property
    def axes(self) -> dict[str, np.ndarray]:
        """Values of the axes in `over`, SI units."""
        return {name: axis_values(name, declared) for name, declared in self.over.items()}

    def points(self) -> Iterator[dict[str, float]]:
        """Yield the parameters at each point of `over`, with the fixed ones."""
        for values in product(*self.axes.values()):
            yield self.fixed | {name: float(value) for name, value in zip(self.axes, values, strict=True)}

    def parts(self) -> dict[str, Maker]:
        """Return the parts of the table: the name of each part, and the function that makes it."""
        if self.curves is not None:
            return {kind: partial(_curve, self, self.curves, kind) for kind in self.curves.kinds}
        if self.branches is not None:
            pairs = enumerate(product(self.points(), self.branches.ends))
            return {f"branch-{k}": partial(_branch, self, self.branches, k, at, to) for k, (at, to) in pairs}
        assert self.families is not None
        return {f"family-{k}": partial(_family, self, self.families, at) for k, at in enumerate(self.points())}

    @property
    def configuration(self) -> dict[str, Any]:
        """All settings that decide the numbers, as JSON can hold them, with the version of the kernel."""
        return self.model_dump(mode="json", exclude_none=True) | {"kernel_version": kernel_version(*ORBITS_CODE)}

    @property
    def what(self) -> str:
        """The word curves, branches or families, whichever the file declares."""
        return next(name for name in ("curves", "branches", "families") if getattr(self, name) is not None)


def read_borders(path: str | os.PathLike[str]) -> Borders:
    """Read a file of borders, and check it.

    Raises
    ------
    ParameterError
        If the file cannot be read, or has a key or a value that is not allowed.
    """
    return read_sections(Path(path), Borders, _check)


def _check(declared: Borders) -> None:
    """Put values in SI units, and refuse sections that do not go together (ParameterError).

    Refused are, for example, a name that comes twice, and a parameter without effect.
    """
    curves, branches, families = declared.curves, declared.branches, declared.families
    if sum(part is not None for part in (curves, branches, families)) != 1:
        raise ParameterError("must have one of [curves], [branches] and [families]")
    if curves is not None:
        check_name(curves.parameter)
        for kind in curves.kinds:
            if kind not in BORDER_KINDS:
                raise ParameterError(f"curves.kinds: {unknown(kind, 'border', BORDER_KINDS)}")
    varied = [*declared.over, *(part.parameter for part in (curves, branches) if part is not None)]
    spelt = spelt_out(declared.fixed, dict.fromkeys(varied))
    declared.fixed = {name: fixed_value(name, value) for name, value in spelt.items()}
    if branches is not None:
        units = units_along(branches.parameter)
        branches.ends = _distinct("branches.ends", [as_number("branches.ends", end, units) for end in branches.ends])
    for section, names in {"over": declared.over, "fixed": declared.fixed}.items():
        for name in names:
            _check_in_section(declared, section, name)
    for point in declared.points():
        given = checked(point)
        if families is not None:
            spin_range(families.spin, given)
        elif curves is not None:
            checked_spin(curves.spin, given)
        elif branches is not None:
            checked_spin(branches.spin, given)
            for end in branches.ends:
                checked_spin(end, given) if branches.parameter == "spin" else checked(given | {branches.parameter: end})


def _check_in_section(declared: Borders, section: str, name: str) -> None:
    """Refuse a parameter that a section (over or fixed) must not have (ParameterError)."""
    curves, part = declared.curves, declared.curves or declared.branches or declared.families
    check_name(name)
    # in `fixed` it is allowed for a branch, which begins at this value of its parameter
    if name == getattr(part, "parameter", None) and (curves or section == "over"):
        raise ParameterError(f"{section}.{name}: is what the {declared.what} are solved for")
    if section == "over" and name in declared.fixed:
        raise ParameterError(f"over.{name}: is fixed, too")
    # without a spin, the lateral speed decides the spin that a start rolls up to; curves have one spin for all points
    rolls_up = name == "xdot0" and part is not None and part.spin is None
    if name in (*START, "phi0") and not (rolls_up and not (curves and section == "over")):
        raise ParameterError(f"{section}.{name}: is of a start, and changes no orbit")


def make_borders(
    declared: Borders, out: str | os.PathLike[str] | None = None, *, force: bool = False, tell: Tell = lambda _: None
) -> xr.Dataset:
    """Make the table that a file declares, and write it.

    With an `out`, each finished part (a curve, a branch, a family) is kept in the store ``<out>.parts`` beside it until
    the file is written. The same call resumes where a former one was stopped or killed.

    Parameters
    ----------
    declared : Borders
        The declaration.
    out : path-like, optional
        NetCDF file; by default no file is written.
    force : bool
        If True, an existing file, or parts of another declaration, may be replaced.
    tell : callable
        Called with a line of text when a part is finished.

    Returns
    -------
    xarray.Dataset
        The table of all parts.

    Raises
    ------
    StoreError
        If the output exists or cannot be written, or parts of another declaration lie beside it.
    OrbitError
        If there is no orbit to begin with.
    Stopped
        On Ctrl-C or SIGTERM; the message says which parts are kept.
    """
    out = None if out is None else check_output(out, force=force, what="a table", endings=TABLES)
    prepare_kernel(progress=False)
    start, makers = perf_counter(), declared.parts()
    with opened_store(Store, out and parts_of(out), declared.configuration, len(makers), force=force) as store:
        for line in store.damage:
            warnings.warn(line, RuntimeWarning, stacklevel=2)
        before = _names(store.summaries())
        if before:
            tell(f"{len(before)} of {len(makers)} parts are there already: {', '.join(before)}")
        try:
            tables = []
            for place, (name, make) in enumerate(makers.items()):
                tables.append(make(tell) if out is None else kept_part(store, place, name, partial(make, tell)))
            attrs = attributes(declared.configuration, declared.borders.title, perf_counter() - start)
            attrs["dimersweep_borders"] = attrs.pop("dimersweep_cube")
            made = finished(_joined(declared, tables).assign_attrs(attrs), declared.borders.title)
            if out is not None:
                write_cube(made, out, force=force)
        except KeyboardInterrupt as stop:
            done, kept = len(_names(store.summaries())), "nothing was kept"
            if done:
                kept = f"{done} of {len(makers)} parts are kept in {store.path}; the same command goes on from there"
            raise Stopped(kept, getattr(stop, "signal", signal.SIGINT)) from None
        if out is not None:
            store.remove()
    return made


def parts_of(out: Path) -> Path:
    """Return the path of the store with the finished parts of the file `out`."""
    return out.with_name(out.name + ".parts")


def kept_part(store: Store, place: int, name: str, make: Callable[[], xr.Dataset]) -> xr.Dataset:
    """Return the part with number `place`: read it from the store, or make it and store it.

    A new part is read back from its file, too, so that both have the same encoding.
    """
    row = next(store.meeting(place, place + 1), None)
    made = make() if row is None else None
    with disk_errors(f"{store.path}: finished parts", "run the same again"):
        try:
            if row is not None:
                store.scratch.write_bytes(row.results)
            elif made is not None:
                write_netcdf(made, store.scratch)
                with store.connection:
                    store.put(StoredTile(place, place + 1, name, results=store.scratch.read_bytes()))
            return read_netcdf(store.scratch)
        finally:
            delete(store.scratch)


def _names(rows: Iterable[StoredTile]) -> list[str]:
    """Return the names of stored parts."""
    return [row.what for row in rows]


def plan_borders(declared: Borders, out: Path) -> list[str]:
    """Return lines of text on the parts of a file, and on those that are finished; no file is written."""
    there, makers = _names(finished_at(parts_of(out), declared.configuration)), declared.parts()
    points = declared.families.points if declared.families else prod(len(axis) for axis in declared.axes.values())
    each = f"{points} points each" if declared.what != "branches" else f"{declared.branches.points} points each at most"  # type: ignore[union-attr]
    lines = [f"{declared.what}: {len(makers)} parts, {each}: {', '.join(makers)}"]
    return lines + ([f"there already: {', '.join(there)}"] if there else [])


def _joined(declared: Borders, tables: list[xr.Dataset]) -> xr.Dataset:
    """Return one dataset of all parts.

    Curves lie along `border`, branches along `point`, families along `over`, and meetings of borders along `meeting`.
    """
    along = {"curves": "border", "branches": "point", "families": "over"}[declared.what]
    own, met = zip(*(_parted(table) for table in tables), strict=True)
    kinds = {name: each.dtype for table in own for name, each in table.data_vars.items()}
    # values where a kind of border lacks a column: empty texts, 0 for integers and flags; NaN for floats by default
    lacking = {name: "" if kind.kind in "OU" else kind.type(0) for name, kind in kinds.items() if kind.kind in "OUbi"}
    made = xr.concat(own, dim=along, combine_attrs="override", fill_value=lacking)
    for name in lacking.keys() & {name for name in made if made[name].dtype.kind == "O"}:
        made[name] = made[name].astype(str)
    made.attrs = {}
    if declared.families is not None:
        for name in declared.axes:
            values = [point[name] for point in declared.points()]
            made = made.assign_coords({name: column(along, values, PARAMETERS[name])})
    if declared.curves is not None:
        made = made.assign_coords(kind=column(along, declared.curves.kinds, "kind of border", kind_words()))
        if some := [each for each in met if each]:  # a curve without meetings has no such columns
            made = made.assign(xr.concat(some, dim="meeting", combine_attrs="override").data_vars)
    if part := declared.curves or declared.branches:
        made.attrs["parameter"] = part.parameter
    for variable in made.variables.values():
        variable.encoding = {"dtype": "S1"} if variable.dtype.kind in "OU" else {}  # drop that of the first part
    return made.assign_attrs(what=declared.what)


def _parted(table: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Return a table without its columns along `meeting`, and these columns alone."""
    meetings = [name for name, each in table.data_vars.items() if "meeting" in each.dims]
    return table.drop_vars(meetings), table[meetings].reset_coords(drop=True)


def _curve(declared: Borders, curves: Curves, kind: str, tell: Tell) -> xr.Dataset:
    """Make the border of a kind; the column `ball` is the closed form for a bouncing ball, NaN if there is none."""
    fixed: dict[str, Any] = declared.fixed
    table = border(kind, curves.parameter, over=declared.axes, spin=curves.spin, **fixed)
    found = int(np.isfinite(table[curves.parameter]).sum())
    tell(f"{kind}: {found} of {table[curves.parameter].size} points, {table.attrs['cost']:.0f} periods of the map")
    closed_form = BORDER_KINDS[kind].ball
    if closed_form is not None and curves.parameter == "Gamma":
        e = table["e"] if "e" in table.coords else xr.DataArray(value_of("e_2", checked(declared.fixed)))
        ball = xr.apply_ufunc(np.vectorize(closed_form), e)
        table["ball"] = ball.broadcast_like(table[curves.parameter])
    else:
        table["ball"] = xr.full_like(table[curves.parameter], np.nan)
    said = Quantity("1", "this border of a ball that bounces once a period, in closed form")
    table["ball"].attrs = said.attributes()
    return table


def _branch(
    declared: Borders, branches: Branches, number: int, point: dict[str, float], end: float, tell: Tell
) -> xr.Dataset:
    """Make the branch from the orbit at a point to an end of the parameter."""
    orbit = find(spin=branches.spin, **point)  # type: ignore[arg-type]
    how: dict[str, Any] = {"points": branches.points, "switch": branches.switch, "sequences": branches.words}
    table = follow(orbit, branches.parameter, to=end, **how)
    size = table.sizes["point"]
    tell(f"{_at(point, declared)}to {branches.parameter} = {end:g}: {size} points; {table.attrs['end']}")
    table["branch"] = column("point", np.full(size, number), "number of the branch")
    along = {name: column("point", np.full(size, point[name]), PARAMETERS[name]) for name in declared.over}
    return table.assign_coords(along)


def _family(declared: Borders, families: Families, point: dict[str, float], tell: Tell) -> xr.Dataset:
    """Make the family of orbits at a point; spins that the family does not reach have NaN."""
    try:
        table = family(spin=families.spin, points=families.points, **point)
    except OrbitError as error:
        tell(f"{_at(point, declared)}{error}")
        raise
    tell(f"{_at(point, declared)}{table.sizes['spin']} spins; {table.attrs['low_end']}; {table.attrs['high_end']}")
    words = {name: f"why the family ends at its {name.split('_')[0]}er spin" for name in ("low_end", "high_end")}
    ends = {name: column((), table.attrs[name], text) for name, text in words.items()}
    table = table.drop_vars([name for name in table.data_vars if table[name].dtype.kind not in "fc"])
    spin_attrs = table["spin"].attrs
    table = table.reindex(spin=evenly(families.spin[0], families.spin[1], families.points)).assign(ends)
    table["spin"].attrs = spin_attrs
    return table


def _at(point: dict[str, float], declared: Borders) -> str:
    """Return the values of the axes at a point as the beginning of a line."""
    return "".join(f"{name} = {point[name]:g}, " for name in declared.over)
