"""Borders, branches and families declared in a file, made and labelled as cubes are."""

import os
import tomllib
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr
from pydantic import BaseModel, ConfigDict, ValidationError

from dimersweep.cubes.grid import axis
from dimersweep.errors import OrbitError, ParameterError
from dimersweep.orbits.bordering import border
from dimersweep.orbits.curve import KINDS, ball_flip, ball_fold
from dimersweep.orbits.families import family
from dimersweep.orbits.finding import checked, find
from dimersweep.orbits.following import follow
from dimersweep.parameters import check_name
from dimersweep.storage.netcdf import check_writable, write_cube
from dimersweep.storage.provenance import attributes
from dimersweep.symbols import PARAMETERS

BALL = {"fold": ball_fold, "flip": ball_flip}
Tell = Callable[[str], None]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Head(_Section):
    """What is made, and where to."""

    title: str
    output: str


class Curves(_Section):
    """Borders in one parameter, over the axes in `over`, the last of which the curves go along."""

    kinds: list[str]
    parameter: str = "Gamma"
    spin: float | None = None


class Branches(_Section):
    """Branches in one parameter from the orbits at each point of `over`, to each of `ends`."""

    parameter: str
    ends: list[float]
    spin: float | None = None
    switch: bool = False
    words: bool = True
    points: int = 200


class Families(_Section):
    """The orbits of all spins, at each point of `over`."""

    spin: tuple[float, float]
    points: int = 50


class Borders(_Section):
    """A file of borders: one of `curves`, `branches` and `families`."""

    borders: Head
    curves: Curves | None = None
    branches: Branches | None = None
    families: Families | None = None
    over: dict[str, Any] = {}
    fixed: dict[str, float] = {}

    @property
    def axes(self) -> dict[str, np.ndarray]:
        """Values of the axes in `over`."""
        return {name: axis(name, declared) for name, declared in self.over.items()}

    def points(self) -> Iterator[dict[str, float]]:
        """Parameters at each point of `over`."""
        for values in product(*self.axes.values()):
            yield self.fixed | {name: float(value) for name, value in zip(self.axes, values, strict=True)}


def read_borders(path: str | os.PathLike[str]) -> Borders:
    """A declaration of borders, checked.

    Raises
    ------
    ParameterError
        Naming the word or the value that is not allowed.
    """
    path = Path(path)
    try:
        declared = Borders.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read ({error.strerror})") from None
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(f"{path}: is no TOML file ({error})") from None
    except ValidationError as error:
        first = error.errors()[0]
        raise ParameterError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    if sum(part is not None for part in (declared.curves, declared.branches, declared.families)) != 1:
        raise ParameterError(f"{path}: must have one of [curves], [branches] and [families]")
    for name in declared.fixed:
        check_name(name)
    for kind in declared.curves.kinds if declared.curves else []:
        if kind not in KINDS:
            raise ParameterError(f"{path}: kinds: {kind}: unknown border (allowed: {', '.join(KINDS)})")
    for point in declared.points():
        checked(point)
    return declared


def make_borders(
    declared: Borders, out: str | os.PathLike[str] | None = None, *, force: bool = False, tell: Tell = lambda _: None
) -> xr.Dataset:
    """Make what is declared, and write it.

    Parameters
    ----------
    declared : Borders
    out : path-like, optional
        NetCDF file; without it nothing is written.
    force : bool
        Whether it may replace an existing file.
    tell : callable
        Is given a line as each part is finished.

    Returns
    -------
    xarray.Dataset
    """
    if out is not None:
        check_writable(out, force=force)
    start = perf_counter()
    if declared.curves is not None:
        made = _curves(declared, declared.curves, tell)
    elif declared.branches is not None:
        made = _branches(declared, declared.branches, tell)
    else:
        assert declared.families is not None
        made = _families(declared, declared.families, tell)
    configuration = declared.model_dump(exclude_none=True)
    kept = attributes(configuration, declared.borders.title, perf_counter() - start)
    kept["dimersweep_borders"] = kept.pop("dimersweep_cube")
    made = storable(made)
    made.attrs = {name: value for name, value in made.attrs.items() if isinstance(value, str)} | kept
    if out is not None:
        write_cube(made, out, force=force)
    return made


def storable(table: xr.Dataset) -> xr.Dataset:
    """The same without complex numbers and truth values, which NetCDF does not know."""
    table = table.copy()
    for name in list(table.data_vars):
        column = table[name]
        if column.dtype.kind == "c":
            for part in ("real", "imag"):
                table[f"{name}_{part}"] = (column.dims, getattr(column.values, part), column.attrs)
            table = table.drop_vars([name])
        elif column.dtype.kind == "b":
            flags = {"flag_values": np.array([0, 1], dtype=np.int8), "flag_meanings": "no yes"}
            table[name] = (
                column.dims,
                column.values.astype(np.int8),
                {"long_name": column.attrs.get("long_name", name)} | flags,
            )
        elif column.dtype.kind == "i":
            table[name] = column.astype(np.int32)
    for name in table.variables:
        if table[name].dtype.kind in "OU":
            table[name].attrs.pop("units", None)
    return table


def _curves(declared: Borders, curves: Curves, tell: Tell) -> xr.Dataset:
    axes = declared.axes
    tables, meetings = [], []
    for kind in curves.kinds:
        fixed: dict[str, Any] = declared.fixed
        table = border(kind, curves.parameter, over=axes, spin=curves.spin, **fixed)
        found = int(np.isfinite(table[curves.parameter]).sum())
        tell(f"{kind}: {found} of {table[curves.parameter].size} points, {table.attrs['cost']:.0f} periods of the map")
        beside = [name for name in table.data_vars if "meeting" in table[name].dims]
        meetings.append(table[beside])
        table = table.drop_vars(beside)
        if kind in BALL and curves.parameter == "Gamma":
            e = table["e"] if "e" in table.coords else xr.DataArray(checked(declared.fixed)["e"])
            ball = xr.apply_ufunc(np.vectorize(BALL[kind]), e)
            table["ball"] = ball.broadcast_like(table[curves.parameter])
        else:
            table["ball"] = xr.full_like(table[curves.parameter], np.nan)
        table["ball"].attrs = {"units": "1", "long_name": "the same of a ball, in closed form"}
        tables.append(table)
    made = xr.concat(tables, dim=xr.Variable("kind", np.array(curves.kinds)), combine_attrs="drop")
    met = xr.concat(meetings, dim="meeting", combine_attrs="drop")
    made = made.assign({name: met[name] for name in met.data_vars})
    made.attrs = {"what": "curves", "parameter": curves.parameter}
    return made


def _branches(declared: Borders, branches: Branches, tell: Tell) -> xr.Dataset:
    tables: list[xr.Dataset] = []
    for point in declared.points():
        orbit = find(spin=branches.spin, **point)  # type: ignore[arg-type]
        for end in branches.ends:
            table = follow(
                orbit, branches.parameter, to=end, points=branches.points, switch=branches.switch, words=branches.words
            )
            tell(
                f"{_at(point, declared)}to {branches.parameter} = {end:g}: {table.sizes['point']} points; {table.attrs['end']}"
            )
            columns = {"branch": np.full(table.sizes["point"], len(tables), dtype=np.int32)}
            columns |= {name: np.full(table.sizes["point"], point[name]) for name in declared.over}
            for name, values in columns.items():
                units = PARAMETERS[name]._asdict() if name in PARAMETERS else {"long_name": "number of the branch"}
                table[name] = ("point", values, units)
            tables.append(table)
    made = xr.concat(tables, dim="point", combine_attrs="drop")
    made.attrs = {"what": "branches", "parameter": branches.parameter}
    return made


def _families(declared: Borders, families: Families, tell: Tell) -> xr.Dataset:
    axes = declared.axes
    spins = np.linspace(*families.spin, families.points)
    tables = []
    for point in declared.points():
        try:
            table = family(spin=families.spin, points=families.points, **point)
        except OrbitError as error:
            tell(f"{_at(point, declared)}{error}")
            raise
        tell(f"{_at(point, declared)}{table.sizes['spin']} spins; {table.attrs['low_end']}; {table.attrs['high_end']}")
        ends = {name: ((), table.attrs[name]) for name in ("low_end", "high_end")}
        table = table.drop_vars([name for name in table.data_vars if table[name].dtype.kind not in "fc"])
        tables.append(table.reindex(spin=spins).assign(ends))
    made = xr.concat(tables, dim="over", combine_attrs="drop")
    for name in axes:
        column = [point[name] for point in declared.points()]
        made = made.assign_coords({name: ("over", np.array(column), PARAMETERS[name]._asdict())})
    made.attrs = {"what": "families"}
    return made


def _at(point: dict[str, float], declared: Borders) -> str:
    return "".join(f"{name} = {point[name]:g}, " for name in declared.over)
