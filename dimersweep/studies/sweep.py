"""Sweeps: every point of a grid, or of a table, is run once."""

from collections.abc import Mapping
from typing import Any, Literal, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.grid import Grid, make_grid, make_points
from dimersweep.errors import ParameterError
from dimersweep.extensions import OBSERVERS, load
from dimersweep.inputs import check_count, check_switch
from dimersweep.parameters import check_level
from dimersweep.runs.solving import run_settings
from dimersweep.storage.provenance import check_attrs
from dimersweep.studies.making import make_cube
from dimersweep.studies.observers import Certify, Observer, strobes_of
from dimersweep.studies.observing import own_of
from dimersweep.studies.study import Study
from dimersweep.work.options import OptionKeywords


def study_of(
    axes: Mapping[str, Any] | None,
    fixed: Mapping[str, Any] | None = None,
    *,
    points: Any = None,
    certify: bool = False,
    strobes: int = 0,
    carry: str | None = None,
    sustained: bool = False,
    observe: Any = None,
    observe_with: Mapping[str, Any] | None = None,
    **how: Any,
) -> Study:
    """Check a sweep and return it as a study, see `sweep`; `how` has the arguments of `run_settings`.

    Raises
    ------
    ParameterError
        If settings are not allowed, or do not go together.
    """
    if (axes is None) == (points is None):
        raise ParameterError('grid: give either a grid, such as {"f": [15, 20]}, or points')
    if carry is not None and axes is None:
        raise ParameterError(f"carry = {carry!r}: is for grids, whose last axis it goes along, not for single points")
    grid: Grid = make_points(points, fixed) if axes is None else make_grid(axes, fixed, carry=carry)
    sure: tuple[Observer, ...] = (Certify(),) if check_switch("certify", certify) else ()
    if carry is not None and sure:
        raise ParameterError("certify: is for points that start by themselves, and goes without carry")
    still = (load(OBSERVERS["sustained"], "sustained")(),) if check_switch("sustained", sustained) else ()
    if still:
        # the plate must be level at all points; an axis is level if its greatest value is
        most = {name: float(np.abs(values).max()) for name, values in (grid.columns or grid.axes).items()}
        check_level(grid.fixed | most, "sustained spins")
    settings, seen = run_settings(**how), (*sure, *strobes_of(strobes, grid.size), *still)
    own = own_of(observe, grid.size, settings, others=seen, axes=grid.axes, arguments=observe_with)
    return Study(grid=grid, how=settings, observers=(*seen, *own))


def sweep(
    grid: Mapping[str, Any] | None = None,
    fixed: Mapping[str, Any] | None = None,
    *,
    points: Any = None,
    periods: int,
    max_periods: int | None = None,
    rtol: float = 1e-8,
    stop_when_settled: bool = True,
    certify: bool = False,
    strobes: int = 0,
    carry: Literal["up", "down", "both"] | None = None,
    sustained: bool = False,
    observe: Any = None,
    **options: Unpack[OptionKeywords],
) -> xr.Dataset:
    """Run the dimer at every point of a grid, or at the points of a table.

    With an `out`, finished points are kept in the file ``<out>.tiles`` beside it until the cube is written. The same
    call resumes a sweep that was stopped or killed, with any number of workers.

    Parameters
    ----------
    grid : mapping of str to array_like or mapping
        The axes: a parameter's name (see `Parameters`) and its values, or ``{"start", "stop", "step" or "num"}`` with
        the stop included; ``"unit": "deg"`` for angles in degrees. SI units otherwise.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.
    points : mapping of str to array_like, pandas.DataFrame or xarray.Dataset, optional
        In place of a grid: columns of one length, one for each parameter that varies, in SI units. The cube then lies
        along `point`. Random and Latin hypercube sets come from `scipy.stats.qmc`.
    periods : int
        Longest run of a point in forcing periods.
    max_periods : int, optional
        If given, a point that has not settled is run again for twice as many forcing periods, and so on up to
        `max_periods`. So only slowly settling motions cost more.
    rtol : float
        Accuracy [1], 1e-13 to 1e-2.
    out : path-like, optional
        NetCDF file to write the cube to, whole or not at all; or, if it ends in .zarr, a Zarr group, for cubes larger
        than memory. A complete cube of this very sweep is read and returned.
    workers : int, optional
        Threads; by default one for each core.
    progress : bool
        If True, show finished points, time left and a tally of modes on stderr.
    stop_when_settled : bool
        If True, a run stops as soon as its motion has settled and its numbers stand (docs/stopping.md).
    certify : bool
        If True, each mode gets a `confidence` and each orbit an `error_estimate`, from two more runs of every point
        that settles (docs/trust.md).
    strobes : int
        If above 0, each run goes on for this number of forcing periods, and the states at their ends are kept; see
        `bifurcation`.
    carry : {"up", "down", "both"}, optional
        Carry the state on along the last axis of the grid, from its least value to its greatest, from its greatest to
        its least, or once each way. A run starts from the end of the run before it, as a state relative to the plate.
        The first run of a line starts as its parameters say. The cube then has the dimension `direction`, and `loops`
        finds where the two ways part and meet. Lines run in parallel, each of them in one piece.
    sustained : bool
        If True, count the sustained spins of each point, and record the circle that attracts it (`orbits.sustained`).
    observe : callable or str, optional
        An observer of your own, which `observer` has marked, or its place, such as ``"my_module:spectral"``. The cube
        has the variables that it returns for the run of each point (docs/observers.md).
    force : bool
        If True, `out` may replace an existing file, and results of another configuration may be deleted.
    attrs : mapping, optional
        Further global attributes, such as a title: names with texts, numbers or lists of numbers.
    client : distributed.Client or str, optional
        A dask.distributed client, or the address of a scheduler such as ``tcp://host:8786``, to run on.
    extend : path-like, optional
        A cube whose points are taken over where this grid has them, value by value; same settings, same kernel.
    retry : bool
        If True, points of `out` (or `extend`) that failed are run again.
    fail_fast : bool
        If True, stop at the first point that fails; finished points are kept.
    keep_tiles : bool
        If True, the store of finished points stays when the cube is written.
    give_up_after : float or str, optional
        Longest time without a result of any worker [s], or a text such as ``"30 min"``; then the sweep ends. By default
        it waits without end.
    part : str or pair of int, optional
        ``"3/20"``, or ``(3, 20)``: run every 20th tile alone, beginning with the 3rd, and write the cube of these
        points to `out` with ``.part-3-of-20`` before its ending. `merge` makes one cube of all parts.

    Returns
    -------
    xarray.Dataset
        `mode`, `status`, orbit quantities and counts over the axes, with units and provenance. The numbers depend
        neither on the workers nor on how the grid is cut into tiles.

    Raises
    ------
    ParameterError
        For a grid, a parameter or a setting that is not allowed, before any work.
    StoreError
        For an `out` that cannot be written or belongs to another sweep, before any work; or for a disk error later.
    PointError
        With `fail_fast`, for the first point that fails.
    KernelError
        If the compiled kernel cannot run here, or on a worker, or gives wrong numbers there.
    UnfinishedError
        If points could not be run for a reason outside the model, such as no memory or a worker that died. These points
        are still to be run; finished points are kept.
    Stopped
        A KeyboardInterrupt, after Ctrl-C or SIGTERM; finished points are kept.

    Examples
    --------
    >>> from dimersweep import names, sweep
    >>> cube = sweep({"Gamma": [0.6, 0.9], "beta0": ["12 deg", "16 deg"]}, periods=60, progress=False)
    >>> names(cube["mode"]).values.tolist()
    [['rest', 'rest'], ['rest', 'drift']]
    """
    if sustained:
        options["attrs"] = {"plot": "circles"} | check_attrs(options.get("attrs"))
    how: dict[str, Any] = {"periods": periods, "max_periods": max_periods, "rtol": rtol}
    how["stop_when_settled"] = stop_when_settled
    how |= {"certify": certify, "strobes": strobes, "carry": carry, "sustained": sustained}
    study = study_of(grid, fixed, points=points, observe=observe, **how)
    return make_cube(study, **options)


class SweepKeywords(OptionKeywords, total=False):
    """Settings and options of `sweep` that `bifurcation` takes, too."""

    points: Any
    max_periods: int | None
    rtol: float
    stop_when_settled: bool
    certify: bool
    carry: Literal["up", "down", "both"] | None
    sustained: bool
    observe: Any


def bifurcation(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None = None,
    *,
    periods: int,
    strobes: int = 64,
    **how: Unpack[SweepKeywords],
) -> xr.Dataset:
    """Make a bifurcation diagram: states at the starts of forcing periods, after the transients, over any axis.

    Parameters
    ----------
    grid, fixed
        As in `sweep`.
    periods : int
        Longest run before the strobes, in forcing periods; it ends earlier if the motion settles.
    strobes : int
        Number of forcing periods at whose starts states are kept.
    **how
        Further options, as in `sweep`; with ``carry="both"`` the diagram shows hysteresis.

    Returns
    -------
    xarray.Dataset
        A cube of `sweep`, with `strobe_gap_1`, `strobe_gap_2`, their rates, `strobe_theta_rate` and `strobe_beta_rate`
        along `strobe`. ``cube.dimersweep.plot()`` draws it.

    Raises
    ------
    ParameterError, StoreError, PointError, Stopped
        As by `sweep`.

    Examples
    --------
    >>> from dimersweep import bifurcation
    >>> diagram = bifurcation({"Gamma": [0.9, 1.0]}, periods=60, strobes=4, progress=False)
    >>> diagram["strobe_gap_2"].sizes["strobe"]
    4
    """
    how["attrs"] = {"plot": "bifurcation"} | check_attrs(how.get("attrs"))
    return sweep(grid, fixed, periods=periods, strobes=check_count("strobes", strobes), **how)
