"""Add methods to datasets as ``data.dimersweep``: ``cube.dimersweep.run(f=15)`` or ``branch.dimersweep.plot()``."""

import warnings
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import check_codes, names, number_of, same_number, without_attrs
from dimersweep.cubes.findings import nearest
from dimersweep.errors import ParameterError, unknown
from dimersweep.extensions import ATTRACTORS, ORBITS_CODE, TABLE_PICTURES, load
from dimersweep.inputs import check_count, check_switch
from dimersweep.kernel import kernel_version
from dimersweep.kernel.model.layout import M_DRIFT
from dimersweep.runs.carrying import run_in_line
from dimersweep.runs.point_source import TAKE_WHOLE, source_of
from dimersweep.runs.run import Run
from dimersweep.runs.solving import exactly
from dimersweep.storage.cubefiles import modes_in, write_cube
from dimersweep.storage.outputs import TABLES, check_output
from dimersweep.symbols import PARAMETERS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from dimersweep.plots.style import Look


def _numbered(cube: xr.Dataset, name: str, value: Any) -> xr.Dataset:
    """Return the part of a cube at a number along a dimension without values, such as ``point=7``."""
    n = cube.sizes[name]
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 0 <= value < n:
        raise ParameterError(f"{name} = {value!r}: must be a whole number from 0 to {n - 1}")
    return cube.isel({name: int(value)})


def is_of_this_kernel(kernel: float, what: str) -> bool:
    """Return True if a cube was made by this version of the kernel; else warn that `what` follows, and return False.

    `kernel` is the number of the cube's kernel (`cubes.cube.number_of`).
    """
    if any(same_number(kernel, number_of(version)) for version in (kernel_version(), kernel_version(*ORBITS_CODE))):
        return True
    warnings.warn(f"the cube was made by another version of the kernel; {what}", RuntimeWarning, stacklevel=3)
    return False


def _check_same(run: Run, point: xr.Dataset) -> None:
    """Refuse a run whose numbers are not those that the cube has at its point: then something changed the point."""
    for name in ("n_periods", "n_events"):
        recorded, found = point[name].values.item() if name in point else None, getattr(run, name)
        if recorded not in (None, found):
            raise ParameterError(f"{name} = {recorded:.0f}: is {found} in the run of these parameters; {TAKE_WHOLE}")


class DatasetAccessor:
    """Methods of a cube of `sweep`, `search` or `refine`, or of a table such as a branch, as ``data.dimersweep``.

    Parameters
    ----------
    data : xarray.Dataset

    Raises
    ------
    ParameterError
        If the data are a table, and a method is for cubes alone.
    """

    def __init__(self, data: xr.Dataset) -> None:
        self._data = data

    @property
    def is_cube(self) -> bool:
        """True if the data are a cube, False if they are a table."""
        data = self._data
        return "mode" in data and "flag_meanings" in data["mode"].attrs and ATTRACTORS not in data.variables

    @property
    def _cube(self) -> xr.Dataset:
        """The data, if they are a cube; else a `ParameterError` is raised."""
        if not self.is_cube:
            raise ParameterError("dimersweep: the dataset is no cube of dimersweep (it has no modes)")
        return self._data

    def __repr__(self) -> str:
        if not self.is_cube:
            return repr(self._data)
        mode = self._cube["mode"]
        check_codes(mode)
        axes = ", ".join(f"{name} ({n})" for name, n in mode.sizes.items()) or "one point"
        tally = ", ".join(f"{word} {count}" for word, count in modes_in(self._cube).items())
        return f"<cube of dimersweep over {axes}: {tally or 'no points'}>"

    def _repr_html_(self) -> str:
        from dimersweep.plots.tables import cube_table

        return cube_table(self._cube) if self.is_cube else self._data._repr_html_()

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the data as a table of pandas with one row a point, and words in place of codes.

        Values along a dimension of its own become columns, such as `multipliers_real_0`. The dimensions of the first
        variable are those of the points: variables that lie along others alone, such as the meetings of borders, are
        left out. So are fixed parameters.
        """
        data = names(self._data)
        dims = next(iter(data.data_vars.values())).dims
        if not dims:
            data, dims = data.expand_dims("point"), ("point",)
        columns = {}
        for name, each in data.data_vars.items():
            others = {dim: n for dim, n in each.sizes.items() if dim not in dims}
            for place in np.ndindex(*others.values()) if {*dims} <= {*each.dims} else ():
                at = each.isel(dict(zip(others, place, strict=True)), drop=True)
                columns["_".join(map(str, (name, *place)))] = at
        table = xr.Dataset(columns)
        fixed = [name for name, each in table.coords.items() if not each.ndim]
        return table.drop_vars(fixed).to_dataframe(dim_order=list(dims))

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the data to the NetCDF file `path`, which other programs can read, too; see docs/cubes.md.

        Raises
        ------
        ParameterError, StoreError
            If `path` has another ending, exists already while `force` is not given, or cannot be written.
        """
        path = check_output(path, force=force, name="path", what="a dataset", endings=TABLES)
        write_cube(self._data, path, force=force)
        return path

    def drifts(self) -> xr.DataArray:
        """Return a mask of the points that drift, bool, over the axes of the cube."""
        return without_attrs(self._cube["mode"] == M_DRIFT).rename("drifts")

    def modes(self) -> xr.DataArray:
        """Return the words of the modes, over the axes of the cube."""
        return names(self._cube["mode"])

    def at(self, **where: Any) -> xr.Dataset:
        """Return the point of the cube that is nearest to values of its axes.

        Parameters
        ----------
        **where : float or str
            Axes and values, such as ``f=15, beta0="16 deg"``, or ``direction="down"`` where a state was carried. A cube
            of single points takes the number of the point, such as ``point=7``.

        Raises
        ------
        ParameterError
            If a name is no axis, a value lies beyond its axis, or no value is given for an axis of several.
        """
        axes = {str(name): n for name, n in self._cube["mode"].sizes.items()}
        picked = self._cube
        for name, value in where.items():
            if name not in axes:
                raise ParameterError(unknown(name, "axis of the cube", axes))
            named = name in PARAMETERS or name == "direction"
            picked = nearest(picked, name, value) if named else _numbered(picked, name, value)
        for name, n in axes.items():
            if name not in where and n != 1:
                raise ParameterError(f"{name}: has {n} values; give one of them")
        return picked.squeeze(dim=[name for name in axes if name in picked["mode"].dims])

    def run(self, *, periods: int | None = None, record: bool = True, **where: Any) -> Run:
        """Make the run behind a point again; the point is the nearest one to values of the axes.

        Of a search it is the run that decided at the point. It is the same run, bit for bit. A run that had not settled
        after the `periods` of the cube was made anew, twice as long, up to `max_periods`. Where a state was carried to
        the point, the runs before it on its line are made first.

        Parameters
        ----------
        periods : int, optional
            Forcing periods, in place of those of the cube. If given, the run does not stop when it has settled.
        record : bool
            True to record events and states, as in `simulate`.
        **where : float or str
            Axes and values, see `at`.

        Returns
        -------
        Run

        Raises
        ------
        ParameterError
            If `where` does not give one point, or a search has found no run there.
        """
        point = self.at(**where)
        made = source_of(point)
        same = is_of_this_kernel(made.kernel, "the run may differ from what it says of the point")
        how = made.how if periods is None else exactly(check_count("periods", periods), made.how.rtol)
        before = () if made.line is None else made.line.rows_at(np.arange(made.place))
        run = run_in_line(
            made.parameters, how, record=check_switch("record", record), before=before, how_before=made.how
        )
        if periods is None and same:
            _check_same(run, point)
        return run

    def plot(
        self,
        kind: str | None = None,
        path: str | PathLike[str] | None = None,
        *,
        quantity: str | None = None,
        force: bool = False,
        **look: "Unpack[Look]",
    ) -> "Figure":
        """Draw a cube, attractors, or a branch, borders or a family of `orbits`; write the picture to `path` if given.

        Parameters
        ----------
        kind : str, optional
            Kind of picture, such as mode_map; by default the kind that the cube was declared for. A table has one.
        path : path-like, optional
            File of the picture.
        quantity : str, optional
            A variable of the cube, to be drawn over its axes.
        force : bool
            True if an existing file at `path` may be replaced.
        **look : see `dimersweep.plots.Look`

        Raises
        ------
        ParameterError
            If the data cannot be drawn so.
        """
        from dimersweep.plots import check_picture, draw, write_picture

        if path is not None:
            check_picture(path, force=force, name="picture")
        if self.is_cube or kind or quantity:
            figure = draw(self._cube, kind, quantity=quantity, **look)
        else:
            place = next(place for mark, place in TABLE_PICTURES.items() if not mark or mark in self._data.variables)
            figure = load(place, "plot")(self._data, **look)
        if path is not None:
            write_picture(figure, path, force=force)
        return figure
