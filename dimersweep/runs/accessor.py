"""What a cube can do: ``cube.dimersweep.plot()``, ``.run(f=15, beta0="16 deg")``, ``.drifts()``."""

import warnings
from os import PathLike
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import check_codes, kernel_number, names
from dimersweep.cubes.findings import nearest
from dimersweep.errors import ParameterError, unknown
from dimersweep.inputs import check_count, check_switch
from dimersweep.kernel import kernel_version
from dimersweep.kernel.model.layout import M_DRIFT
from dimersweep.runs.behind import AS_MADE, behind
from dimersweep.runs.carrying import run_in_line
from dimersweep.runs.run import Run
from dimersweep.runs.solving import exactly
from dimersweep.storage.cubefiles import modes_in
from dimersweep.symbols import PARAMETERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dimersweep.plots.style import Look


def _numbered(cube: xr.Dataset, name: str, value: Any) -> xr.Dataset:
    """The part of a cube at a number along a dimension without values, such as ``point=7``."""
    n = cube.sizes[name]
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 0 <= value < n:
        raise ParameterError(f"{name} = {value!r}: must be a whole number from 0 to {n - 1}")
    return cube.isel({name: int(value)})


def is_of_this_kernel(kernel: float, what: str) -> bool:
    """Whether a cube was made by this kernel, whose number it tells; if not, warn of runs that are made again."""
    if kernel == kernel_number(kernel_version()):
        return True
    warnings.warn(f"the cube was made by another version of the kernel; {what}", RuntimeWarning, stacklevel=3)
    return False


def _check_same(run: Run, point: xr.Dataset) -> None:
    """Refuse a run that is not the one that a point tells of, whatever changed the point."""
    for name in ("n_periods", "n_events"):
        told, found = point[name].values.item() if name in point else None, getattr(run, name)
        if told not in (None, found):
            raise ParameterError(f"{name} = {told:.0f}: is {found} in the run of these parameters; {AS_MADE}")


@xr.register_dataset_accessor("dimersweep")
class CubeAccessor:
    """A cube of `sweep`, `search` or `refine`, as ``cube.dimersweep``.

    Parameters
    ----------
    cube : xarray.Dataset

    Raises
    ------
    ParameterError
        If it is no such cube.
    """

    def __init__(self, cube: xr.Dataset) -> None:
        if "mode" not in cube or "flag_meanings" not in cube["mode"].attrs:
            raise ParameterError("dimersweep: the dataset is no cube of dimersweep (it has no modes)")
        self._cube = cube

    def __repr__(self) -> str:
        mode = self._cube["mode"]
        check_codes(mode)
        axes = ", ".join(f"{name} ({n})" for name, n in mode.sizes.items()) or "one point"
        tally = ", ".join(f"{word} {count}" for word, count in modes_in(self._cube).items())
        return f"<cube of dimersweep over {axes}: {tally or 'no points'}>"

    def _repr_html_(self) -> str:
        from dimersweep.plots.tables import cube_table

        return cube_table(self._cube)

    def drifts(self) -> xr.DataArray:
        """Which points drift, bool, over the axes of the cube."""
        return (self._cube["mode"] == M_DRIFT).drop_attrs().rename("drifts")

    def modes(self) -> xr.DataArray:
        """The words of the modes, over the axes of the cube."""
        return names(self._cube["mode"])

    def at(self, **where: Any) -> xr.Dataset:
        """The point of the cube that is nearest to values of its axes.

        Parameters
        ----------
        **where : float or str
            Axes and values, such as ``f=15, beta0="16 deg"``; ``direction="down"`` where a state was carried; or
            ``point=7``, its number, of points that are no grid.

        Raises
        ------
        ParameterError
            If a name is no axis, a value lies beyond it, or an axis of several values has none.
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
        """The run behind a point: the one nearest to values of the axes; of a search, the one that decided.

        It is the same run, bit for bit: one that had not settled after the `periods` of the cube was made anew, twice as long,
        up to `max_periods`. Where a state was carried to it, the runs before it on its line are made first.

        Parameters
        ----------
        periods : int, optional
            Forcing periods, in place of those of the cube: then the run does not stop when it has settled.
        record : bool
            As in `simulate`.
        **where : float or str
            See `at`.

        Returns
        -------
        Run

        Raises
        ------
        ParameterError
            If that is not one point, or a search has found no run there.
        """
        point = self.at(**where)
        made = behind(point)
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
        """Draw the cube, and write the picture to `path` if one is given.

        Parameters
        ----------
        kind : str, optional
            Such as mode_map; by default the one that the cube was declared for.
        path : path-like, optional
            Picture to write.
        quantity : str, optional
            A variable of the cube, to be drawn over its axes.
        force : bool
            Whether `path` may be replaced.
        **look : see `dimersweep.plots.Look`

        Raises
        ------
        ParameterError
            If the cube cannot be drawn so.
        """
        from dimersweep.plots import check_picture, draw, write_picture

        if path is not None:
            check_picture(path, force=force, name="picture")
        figure = draw(self._cube, kind, quantity=quantity, **look)
        if path is not None:
            write_picture(figure, path, force=force)
        return figure
