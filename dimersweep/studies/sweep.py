"""A whole sweep: a grid in, a labelled cube out."""

from collections.abc import Mapping
from functools import partial
from typing import Any, Literal, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import build, flatten
from dimersweep.cubes.results import beyond, blank_results, not_ok
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count
from dimersweep.storage.provenance import check_attrs
from dimersweep.studies.making import complete_cube, unfinished_cube
from dimersweep.studies.reuse import known_points
from dimersweep.studies.strobes import with_strobes
from dimersweep.studies.sweep_spec import Spec, make_spec
from dimersweep.work.options import Given, Options, make_options


def run_sweep(spec: Spec, options: Options) -> xr.Dataset:
    """The cube of a sweep: what is there already, then what is missing.

    Raises
    ------
    ParameterError, StoreError, KernelError, PointError, UnfinishedError, Stopped
        See `sweep`.
    """
    if spec.grid.columns and options.extend is not None:
        raise ParameterError("extend: is for grids, not for single points")
    former = complete_cube(spec, options)
    if former is not None:
        return former

    def again(results: np.ndarray) -> np.ndarray:
        return spec.whole_lines(not_ok(results["codes"]))

    def unwanted(codes: np.ndarray) -> np.ndarray:
        return spec.whole_lines(options.unwanted(codes))

    with unfinished_cube(spec, options, again) as cube:
        others, origin = known_points(spec, options, partial(results_of, spec))
        for other in others:
            cube.crew.take_over(other.pieces(cube.store.gaps(), unwanted))
        cube.crew.expect(spec.grid.size)
        cube.crew.run(spec, cube.store.gaps())
        if cube.by_blocks:
            return cube.write_blocks(cube.attributes(origin))
        return cube.write(as_cube(spec, cube.results(), cube.attributes(origin)))


def as_cube(spec: Spec, results: np.ndarray, attributes: Mapping[str, Any]) -> xr.Dataset:
    """Results of all points, shape (spec.grid.size,), as a labelled cube with global attributes."""
    more = {name: values for name, values in beyond(results).items() if values.ndim == 1}
    cube = build(spec.grid, results["out"], results["codes"], attributes, more)
    return with_strobes(cube, results) if spec.strobes else cube


def results_of(spec: Spec, cube: xr.Dataset) -> np.ndarray:
    """The results that `as_cube` made a cube of."""
    results = blank_results(cube["mode"].size, spec.kind)
    results["out"], results["codes"] = flatten(cube)
    for name in beyond(results):
        results[name] = cube[name].values.reshape(results[name].shape)
    return results


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
    **options: Unpack[Given],
) -> xr.Dataset:
    """Run the dimer at every point of a grid, or at points of a table.

    With an `out`, finished points are kept in the file ``<out>.tiles`` beside it until the cube is written: the same call
    goes on where a former one was stopped or killed, with any number of workers.

    Parameters
    ----------
    grid : mapping of str to array_like or mapping
        The axes: a parameter's name (see `Parameters`) and its values, or ``{"start", "stop", "step" or "num"}`` with
        the stop included; ``"unit": "deg"`` for angles in degrees. SI units otherwise.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.
    points : mapping of str to array_like, pandas.DataFrame or xarray.Dataset, optional
        In place of a grid: columns of one length, one for each parameter that varies, in SI units. The cube then lies along
        `point`. Random and Latin hypercube sets come from `scipy.stats.qmc`.
    periods : int
        Forcing periods each point may take.
    max_periods : int, optional
        If given, a point that has not settled is run again for twice as many forcing periods, and so on up to these, so
        that only what rings down slowly costs more.
    rtol : float
        Accuracy [1], 1e-13 to 1e-2.
    out : path-like, optional
        NetCDF file to write the cube to, whole or not at all; or, if it ends in .zarr, a Zarr group, for cubes larger
        than memory. A complete cube of this very sweep is read and returned.
    workers : int, optional
        Threads; by default one for each core.
    progress : bool
        Whether to show finished points, time left and a tally of modes on stderr.
    stop_when_settled : bool
        Whether a point stops as soon as its motion has settled and its numbers stand (docs/stopping.md).
    certify : bool
        Whether each mode gets a `confidence` and each orbit an `error_estimate`, from two more runs of every point that
        settles (docs/trust.md).
    strobes : int
        If above 0, each run goes on for so many forcing periods, and the states at their ends are kept; see `bifurcation`.
    carry : {"up", "down", "both"}, optional
        Carry the state on along the last axis of the grid, from its least value to its greatest, from its greatest to its
        least, or once each way: a run starts from the state, relative to the plate, that the run before it has ended in. The
        first run of a line starts as its parameters say. The cube then has the dimension `direction`, and `loops` finds
        where the two part and meet. Lines run in parallel, each of them in one piece.
    force : bool
        Whether `out` may replace an existing file, and results of another configuration be deleted.
    attrs : mapping, optional
        Further global attributes, such as a title: names with texts, numbers or lists of numbers.
    client : distributed.Client or str, optional
        A dask.distributed client, or the address of a scheduler such as ``tcp://host:8786``, to run on.
    extend : path-like, optional
        A cube whose points are taken over where this grid has them, value by value; same settings, same kernel.
    retry : bool
        Whether points of `out` (or `extend`) that failed are run again.
    fail_fast : bool
        Whether to stop at the first point that fails; what was finished is kept.
    keep_tiles : bool
        Whether the store of finished points stays when the cube is written.

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
        For an `out` that cannot be written or belongs to another sweep, before any work; or a disk that refuses later.
    PointError
        With `fail_fast`, for the first point that fails.
    KernelError
        If the compiled kernel cannot run here, or on a worker, or gives wrong numbers there.
    UnfinishedError
        If points could not be run for a reason that is not the model's, such as memory that ran out or a worker that
        died: they are still to be done, and what was finished is kept.
    Stopped
        A KeyboardInterrupt, after Ctrl-C or SIGTERM; what was finished is kept.

    Examples
    --------
    >>> from dimersweep import names, sweep
    >>> cube = sweep({"Gamma": [0.6, 0.9], "beta0": ["12 deg", "16 deg"]}, periods=60, progress=False)
    >>> names(cube["mode"]).values.tolist()
    [['rest', 'rest'], ['rest', 'drift']]
    """
    spec = make_spec(
        grid,
        fixed,
        periods=periods,
        max_periods=max_periods,
        rtol=rtol,
        stop_when_settled=stop_when_settled,
        certify=certify,
        points=points,
        strobes=strobes,
        carry=carry,
    )
    return run_sweep(spec, make_options(**options))


def bifurcation(
    grid: Mapping[str, Any], fixed: Mapping[str, Any] | None = None, *, periods: int, strobes: int = 64, **how: Any
) -> xr.Dataset:
    """A bifurcation diagram: the states at the starts of some forcing periods, after the transients, over any axis.

    Parameters
    ----------
    grid, fixed
        As in `sweep`.
    periods : int
        Forcing periods that go before; a run that settles earlier is not followed so far.
    strobes : int
        Forcing periods whose starts are kept.
    **how
        As in `sweep`; with ``carry="both"`` the diagram shows hysteresis.

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
    attrs = {"plot": "bifurcation"} | check_attrs(how.pop("attrs", None))
    return sweep(grid, fixed, periods=periods, strobes=check_count("strobes", strobes), attrs=attrs, **how)
