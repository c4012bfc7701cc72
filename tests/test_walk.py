"""What xarray does to a cube: each point still has the run that made it, or is refused in one line."""

import json
import warnings
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep import plots, simulate, sweep
from dimersweep.errors import ParameterError, UserError
from dimersweep.parameters import Parameters
from dimersweep.storage.checking import checksum_of
from dimersweep.symbols import PARAMETERS, SETTINGS

pytestmark = [
    pytest.mark.jit,
    pytest.mark.filterwarnings("ignore:In a future version of xarray:FutureWarning"),
    pytest.mark.usefixtures("empty_folder"),
]
AXES = {"Gamma": [0.8, 0.95, 1.1], "beta0": [0.2, 0.3]}
QUIET = {"periods": 30, "progress": False}


def marked(cube, first=0):
    """A cube whose points have numbers, by which they are known again, whatever is done to it."""
    mode = cube["mode"]
    return cube.assign(number=(mode.dims, first + np.arange(mode.size).reshape(mode.shape)))


def places_of(cube):
    dims = list(cube["mode"].dims)
    for place in np.ndindex(cube["mode"].shape):
        yield cube.isel(dict(zip(dims, place, strict=True)))


def told_of(run):
    return Parameters(**run.parameters).row().tobytes(), run.mode, run.n_periods, run.n_events, run.rtol


def truth_of(*cubes):
    """The runs of all points, by number; each is the one that the cube tells of."""
    truth = {}
    for cube in cubes:
        for point in places_of(cube):
            run = truth[int(point["number"].values)] = point.dimersweep.run(record=False)
            assert (dimersweep.names(point["mode"]).item(), point["n_events"].values.item()) == (run.mode, run.n_events)
    return truth


def refused(call):
    """What a call gives; None where it is refused in one line."""
    try:
        return call()
    except UserError as error:
        assert "\n" not in str(error) and ": " in str(error)
        return None


def walked(cube, truth, carried=False):
    """How many points of `cube` give the run that made them, each in three ways; all others are refused."""
    right = 0
    for point in places_of(cube):
        run = refused(partial(point.dimersweep.run, record=False))
        begun = None if carried else refused(partial(simulate, start=point, periods=7, record=False))
        if run or begun:
            expected = told_of(truth[int(point["number"].values)])  # without a number no run was made
            assert run is None or told_of(run) == expected
            assert begun is None or told_of(begun)[0] == expected[0]
        right += run is not None
    return right


def drawn(cube):
    """That a cube is drawn, and gives its intervals, or refuses it in one line."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        figure, intervals = refused(cube.dimersweep.plot), refused(partial(plots.drift_intervals, cube))
    plt.close("all")
    return figure, intervals


@pytest.fixture(scope="module")
def cube():
    return marked(sweep(AXES, {"e": 0.55, "tilt": 0.01}, **QUIET))


@pytest.fixture(scope="module")
def truth(cube):
    return truth_of(cube)


WHOLE = {
    "sel": lambda c: c.sel(Gamma=[0.95, 0.8]),
    "sel one": lambda c: c.sel(Gamma=0.95),
    "isel": lambda c: c.isel(beta0=[1, 0]),
    "squeeze": lambda c: c.isel(Gamma=[1]).squeeze(),
    "sortby": lambda c: c.sortby("Gamma", ascending=False),
    "reindex": lambda c: c.reindex(Gamma=[1.1, 0.8]),
    "stack": lambda c: c.stack(point=("Gamma", "beta0")),
    "stack and reset": lambda c: c.stack(point=("Gamma", "beta0")).reset_index("point"),
    "swap_dims": lambda c: c.assign_coords(A=("Gamma", [1.0, 2.0, 3.0])).swap_dims(Gamma="A"),
    "assign_attrs": lambda c: c.assign_attrs(configuration="{}", configuration_sha256="x"),
    "drop_attrs": lambda c: c.drop_attrs(deep=False),
    "rename": lambda c: c.rename(beta0="start").rename(start="beta0"),
    "transpose": lambda c: c.transpose("beta0", "Gamma"),
    "expand_dims": lambda c: c.expand_dims("f"),
    "reset_coords": lambda c: c.reset_coords(["e_1", "tilt", "periods"]),
    "where": lambda c: c.where(c["Gamma"] > 0),
    "a part of the variables": lambda c: c[["mode", "number"]],
}
LOSSES = {
    "sel": (lambda c: c.sel(Gamma=0.95, drop=True), "Gamma"),
    "isel": (lambda c: c.isel(beta0=0, drop=True), "beta0"),
    "squeeze": (lambda c: c.isel(Gamma=[1]).squeeze(drop=True), "Gamma"),
    "an axis": (lambda c: c.drop_vars("Gamma"), "Gamma"),
    "a fixed parameter": (lambda c: c.drop_vars("e_1"), "e_1"),
    "one at its default": (lambda c: c.drop_vars("mu_h_2"), "mu_h_2"),
    "tilt": (lambda c: c.drop_vars("tilt"), "tilt"),
    "rename": (lambda c: c.rename(f="frequency"), "f"),
    "reset": (lambda c: c.isel(Gamma=0).reset_coords("Gamma", drop=True), "Gamma"),
    **{name: (lambda c, name=name: c.drop_vars(name), name) for name in ("periods", "max_periods", "rtol", "kernel")},
    "rule of stopping": (lambda c: c.drop_vars("stop_when_settled"), "stop_when_settled"),
}


@pytest.mark.parametrize("name", WHOLE)
def test_a_part_and_another_order_have_the_runs(cube, truth, name):
    changed = WHOLE[name](cube)
    assert walked(changed, truth) == changed["mode"].size


@pytest.mark.parametrize("name", LOSSES)
def test_what_is_lost_is_named(cube, truth, name):
    """An error in place of the value of the base case."""
    change, lost = LOSSES[name]
    changed = change(cube)
    assert walked(changed, truth) == 0
    with pytest.raises(ParameterError, match=rf"^{lost}: the point has lost it"):
        next(places_of(changed)).dimersweep.run()


@pytest.mark.parametrize("fixed", [{"e": 0.6}, {"e_1": 0.5, "e_2": 0.7}, {"mu_h": 0.3, "mu": 0.2}, {"r_2": 5.1e-3}])
def test_what_holds_at_both_ends_may_be_dropped(fixed):
    """e, where e_1 and e_2 tell it: all parameters are coordinates, those that follow from others too."""
    one = marked(sweep({"Gamma": AXES["Gamma"]}, fixed, **QUIET))
    for name in {"e", "r", "mu_h"} & {*one.coords}:
        assert walked(one.drop_vars(name), truth_of(one)) == 3


# what two cubes may differ in: fixed parameters, and settings
PAIRS = {
    "tilt": ({}, {"tilt": 0.02}, {}),
    "e": ({"e": 0.6}, {"e": 0.65}, {}),
    "one end": ({"e": 0.6}, {"e": 0.6, "e_1": 0.4}, {}),
    "both ends": ({"e": 0.6}, {"e_1": 0.4, "e_2": 0.5}, {}),
    "mu_h": ({}, {"mu_h": 0.3}, {}),
    "r_1": ({}, {"r_1": 5.2e-3}, {}),
    "k_ratio": ({"r_1": 5.2e-3}, {"r_1": 5.2e-3, "k_ratio": 1.0}, {}),
    "second harmonic": ({}, {"Gamma_2": 0.2, "phi_2": 1.0}, {}),
    "periods": ({}, {}, {"periods": 300}),
    "max_periods": ({}, {}, {"max_periods": 120}),
    "rtol": ({}, {}, {"rtol": 1e-6}),
    "stopping": ({}, {}, {"stop_when_settled": False}),
}


def by_files(one, two):
    one.to_netcdf("one.nc")
    two.to_netcdf("two.nc")
    return xr.open_mfdataset(["one.nc", "two.nc"])


TOGETHER = {
    "concat": (lambda one, two: xr.concat([one, two], "Gamma"), True),
    "concat turned": (lambda one, two: xr.concat([two, one], "Gamma"), True),
    "concat on a new axis": (lambda one, two: xr.concat([one, two], "which"), False),
    "combine_by_coords": (lambda one, two: xr.combine_by_coords([one, two], combine_attrs="override"), True),
    "open_mfdataset": (by_files, True),
    "merge": (lambda one, two: xr.merge([one, two]), True),
    "merge turned": (lambda one, two: xr.merge([two, one]), True),
}


@pytest.mark.parametrize("pair", PAIRS)
def test_points_of_two_cubes_keep_what_made_them(pair):
    fixed, other, how = PAIRS[pair]
    axes = {"Gamma": [0.8, 0.95], "beta0": [0.2]}
    one, two, later = (
        marked(sweep(axes | moved, given, **QUIET | more), first)
        for moved, given, more, first in (
            ({}, fixed, {}, 0),
            ({}, other, how, 10),
            ({"Gamma": [1.1, 1.3]}, other, how, 20),
        )
    )
    truth = truth_of(one, two, later)
    few = ("concat", "concat on a new axis", "merge")
    for name in TOGETHER if pair in ("tilt", "both ends", "periods") else few:
        put, moves = TOGETHER[name]
        try:
            both = put(one, later if moves else two)
        except xr.MergeError as error:
            # xarray does not put together coordinates that differ behind one that is in the first cube alone
            assert "conflicting" in str(error) and ("merge" in name or {*one.coords} != {*two.coords}), name
            continue
        assert "merge" not in name, name
        assert walked(both, truth) == 4, name


OVERRIDDEN = {  # and how many points still are of the cube that their parameters come from
    "concat": (lambda one, two, later: xr.concat([one, later], "Gamma", coords="minimal", compat="override"), 2),
    "concat on a new axis": (
        lambda one, two, later: xr.concat([one, two], "which", coords="minimal", compat="override"),
        2,
    ),
    "merge": (lambda one, two, later: xr.merge([one, later], compat="override"), 2),
    "coordinates of another cube": (lambda one, two, later: later.assign_coords(start=one["beta0"]), 0),
    "a fixed parameter": (lambda one, two, later: later.assign_coords(tilt=0.0), 0),
}


@pytest.mark.parametrize("name", OVERRIDDEN)
def test_what_was_taken_from_another_cube_is_seen(name):
    """Where conflicts are overridden, xarray gives the parameters and settings of the first cube to all points."""
    axes = {"Gamma": [0.8, 0.95], "beta0": [0.2]}
    one, two = (marked(sweep(axes, fixed, **QUIET), first) for fixed, first in (({}, 0), ({"tilt": 0.03}, 10)))
    later = marked(sweep(axes | {"Gamma": [1.1, 1.3]}, {"tilt": 0.03}, **QUIET | {"periods": 40}), 20)
    put, right = OVERRIDDEN[name]
    assert walked(put(one, two, later), truth_of(one, two, later)) == right


def test_a_run_that_is_not_the_one_of_the_point_is_refused(cube):
    with pytest.raises(ParameterError, match=r"^n_(events|periods) = \d+: is \d+ in the run of these parameters; take"):
        cube.assign_coords(Gamma=[0.9, 1.0, 1.1]).dimersweep.run(Gamma=0.9, beta0=0.3)


def test_a_merge_of_parts_has_the_runs_of_both(cube, truth):
    parts = [cube.sel(Gamma=[0.8, 1.1]), cube.sel(Gamma=[0.95])]
    assert walked(xr.merge(parts), truth) == 6
    crossed = xr.merge([cube.isel(Gamma=[0], beta0=[0]), cube.isel(Gamma=[1], beta0=[1])])
    assert crossed["mode"].size == 4
    assert walked(crossed, truth) == 2  # the other two were never run
    with pytest.raises(ParameterError, match=r"^mode: has no value at this point"):
        cube.reindex(Gamma=[0.9], beta0=[0.2]).dimersweep.run(Gamma=0.9, beta0=0.2)


@pytest.mark.parametrize("change", [*WHOLE.values(), *(change for change, _ in LOSSES.values())])
def test_a_changed_cube_is_drawn_or_refused(cube, change):
    drawn(change(cube))


def test_pictures_of_two_cubes(cube):
    one, two = (
        sweep({"Gamma": [*gamma], "beta0": [0.1, 0.2, 0.3]}, periods=60, progress=False)
        for gamma in ((0.8, 0.9), (0.85,))
    )
    both = xr.concat([one, two], "Gamma")
    with pytest.raises(ParameterError, match=r"^plot: the values of the axis Gamma are in no order"):
        both.dimersweep.plot()
    with pytest.raises(ParameterError, match=r"^plot: the values of the axis Gamma are in no order"):
        xr.concat([one, one], "Gamma").dimersweep.plot()
    whole = sweep({"Gamma": [0.8, 0.85, 0.9], "beta0": [0.1, 0.2, 0.3]}, periods=60, progress=False)
    put = both.sortby("Gamma")
    np.testing.assert_array_equal(put["mode"], whole["mode"])
    for part in (put, put.sortby("Gamma", ascending=False)):
        rows = plots.drift_intervals(part)
        expected = plots.drift_intervals(whole.sel(Gamma=part["Gamma"]))
        assert [row.tolist() for row in rows] == [row.tolist() for row in expected]


# --- points by the values of their axes -----------------------------------------------------------------------------------


def test_an_axis_of_one_value_takes_that_value_only():
    one = sweep({"e": [0.6], "beta0": ["16 deg"]}, **QUIET)
    assert one.dimersweep.run(e=0.6, beta0="16 deg").parameters["e"] == 0.6
    assert one.dimersweep.run(e=np.nextafter(0.6, 1), beta0=16 * np.pi / 180).parameters["e"] == 0.6
    for wanted in (1.0, 0.6001, 0.59, 0.0):
        with pytest.raises(ParameterError, match=rf"^e = {wanted:g}: must be 0.6$"):
            one.dimersweep.run(e=wanted, beta0="16 deg")
    with pytest.raises(ParameterError, match=r"^beta0 = 0.3: must be 0.279253 rad$"):
        one.dimersweep.run(e=0.6, beta0=0.3)
    level = sweep({"xdot0": [0.0]}, **QUIET)
    assert level.dimersweep.run(xdot0=0).parameters["xdot0"] == 0
    with pytest.raises(ParameterError, match=r"^xdot0 = 1e-09: must be 0 m s-1$"):
        level.dimersweep.run(xdot0=1e-9)


@pytest.mark.parametrize("order", [[2, 1, 0], [1, 0, 2]])
def test_an_axis_in_any_order_has_its_points(cube, truth, order):
    turned = cube.isel(Gamma=order)
    for gamma, near in ((0.8, 0.8), (0.94, 0.95), (1.06, 1.1), (1.17, 1.1)):
        number = int(turned.dimersweep.at(Gamma=gamma, beta0=0.2)["number"])
        assert cube["Gamma"].values[number // 2] == near
    with pytest.raises(ParameterError, match=r"^Gamma = 1.2: must lie on the axis, 0.8 to 1.1$"):
        turned.dimersweep.run(Gamma=1.2, beta0=0.2)
    twice = xr.concat([cube, turned], "Gamma")
    with pytest.raises(ParameterError, match=r"^Gamma = 0.8: the axis has this value 2 times; take one by isel$"):
        twice.dimersweep.run(Gamma=0.8, beta0=0.2)


# --- states that were carried ---------------------------------------------------------------------------------------------

LINE = {"e": [0.55, 0.6], "Gamma": [0.8, 0.9, 1.0]}


@pytest.fixture(scope="module")
def line():
    return marked(sweep(LINE, {"mu_h": 0.4}, carry="both", **QUIET))


def test_carried_points_keep_their_line(line):
    truth = truth_of(line)
    other = marked(sweep(LINE | {"e": [0.65]}, {"mu_h": 0.4}, carry="both", **QUIET), 12)
    truth |= truth_of(other)
    for change in (
        lambda c: c.isel(Gamma=slice(1, None), e=[1]).sortby("Gamma", ascending=False),
        lambda c: c.sel(direction=1).stack(point=("e", "Gamma")),
        lambda c: c.isel(Gamma=[2]).where(c["Gamma"] > 0),
    ):
        changed = change(line)
        assert walked(changed, truth, carried=True) == changed["mode"].size
    assert walked(xr.concat([line, other], "e"), truth, carried=True) == 18
    # along the line itself: each point has a line, of which the attributes tell that of the first cube alone
    longer = marked(sweep(LINE | {"Gamma": [1.1, 1.2]}, {"mu_h": 0.4}, carry="both", **QUIET), 20)
    put = xr.concat([line, longer], "Gamma")
    assert walked(put, truth | truth_of(longer), carried=True) == 12
    with pytest.raises(
        ParameterError, match=r"^line: a state was carried to this point along other values than the cube"
    ):
        put.dimersweep.run(e=0.6, direction="up", Gamma=1.2)


@pytest.mark.parametrize(
    ("change", "lost"),
    [
        (lambda c: c.sel(direction=0, drop=True), "direction"),
        (lambda c: c.drop_vars("line").isel(direction=0), "line"),
        (lambda c: c.sel(Gamma=0.9, drop=True), "Gamma"),
        (lambda c: c.drop_attrs(deep=False), "line"),
        (lambda c: c.drop_vars("mu_h_1"), "mu_h_1"),
    ],
)
def test_a_carried_point_that_has_lost_something_is_refused(line, change, lost):
    point = next(places_of(change(line).isel(Gamma=-1) if lost != "Gamma" else change(line)))
    with pytest.raises(ParameterError, match=rf"^{lost}: "):
        point.dimersweep.run()
    with pytest.raises(ParameterError, match=rf"^(start: to this point a state was carried|{lost}: )"):
        simulate(start=point)


def test_a_line_along_what_others_follow():
    """mu_h is given, so it does not follow mu_s along the line, though the two are equal at its end."""
    whole = sweep({"mu_s": [0.3, 0.35, 0.4]}, {"mu_h": 0.4, "mu": 0.2, "Gamma": 1.2}, carry="up", **QUIET)
    assert truth_of(marked(whole))[2].n_events == whole["n_events"].values[0, 2]


# --- files ----------------------------------------------------------------------------------------------------------------


def as_an_earlier_version(cube):
    """A cube as earlier versions made it: without settings, and without the parameters that were not given."""
    told = json.loads(cube.attrs["configuration"])
    given = {*told.get("grid", {}), *told.get("points", {}), *told["fixed"], told.get("search", {}).get("axis")}
    former = cube.drop_vars([name for name in {*PARAMETERS, *SETTINGS, "made_with"} - given if name in cube.variables])
    return former.assign_attrs(values_sha256=checksum_of(former))


@pytest.mark.parametrize("carry", [None, "both"])
def test_cubes_of_earlier_versions_open_and_run(carry):
    made = sweep({"e": [0.55], "Gamma": [0.8, 0.9, 1.0]}, {"tilt": 0.01}, carry=carry, **QUIET)
    as_an_earlier_version(made).to_netcdf("former.nc")
    former = dimersweep.open_cube("former.nc")
    assert "eta" not in former.variables and "periods" not in former.variables
    truth = truth_of(marked(made))
    assert walked(marked(former), truth, carried=carry) == former["mode"].size
    wider = sweep(
        {"e": [0.5, 0.55], "Gamma": [0.8, 0.9, 1.0]}, {"tilt": 0.01}, carry=carry, extend="former.nc", **QUIET
    )
    xr.testing.assert_equal(wider.sel(e=[0.55]), made)
    for lost in (former.isel(Gamma=0, drop=True), former.drop_vars("tilt"), former.drop_attrs(deep=False)):
        assert walked(marked(lost), truth, carried=True) == 0


def test_a_search_keeps_what_made_its_points():
    grid = {"Gamma": [0.8, 0.9], "e": [0.5, 0.6, 0.65]}
    found = dimersweep.search(
        grid, {"beta0": 0.28}, over="e", ask="first", orbit_periods=130, periods=100, progress=False
    )
    run = found.dimersweep.run(Gamma=0.9)
    assert (run.n_periods, run.n_events) == (130, found["n_events"].values[1])
    assert run.parameters["e"] == found["e"].values[1] == found["e_1"].values[1]
    as_an_earlier_version(found.drop_vars(["e_1", "e_2"])).to_netcdf("former.nc")
    assert dimersweep.open_cube("former.nc").dimersweep.run(Gamma=0.9).n_events == run.n_events
    with pytest.raises(ParameterError, match=r"^Gamma: the point has lost it"):
        found.isel(Gamma=1, drop=True).dimersweep.run()


EXTENDED = {
    "as it is": lambda c: c,
    "sortby": lambda c: c.sortby("Gamma", ascending=False),
    "isel": lambda c: c.isel(Gamma=[0, 2]),
    "drop": lambda c: c.drop_vars("tilt"),
    "settings": lambda c: c.drop_vars("rtol"),
    "assign": lambda c: c.assign_coords(tilt=0.02),
    "assign settings": lambda c: c.assign_coords(periods=31),
    "transpose": lambda c: c.transpose("beta0", "Gamma"),
    "concat": lambda c: xr.concat([c, c.assign_coords(tilt=0.02, Gamma=c["Gamma"].values + 1)], "Gamma"),
    "reindex": lambda c: c.reindex(Gamma=[0.8, 0.9, 0.95, 1.1]),
}


@pytest.mark.parametrize("name", EXTENDED)
def test_a_cube_is_extended_as_it_was_made_or_not_at_all(cube, name):
    fixed = {"e": 0.55, "tilt": 0.01}
    EXTENDED[name](cube.drop_vars("number")).to_netcdf("changed.nc")
    wider = refused(partial(sweep, AXES | {"Gamma": [*AXES["Gamma"], 1.3]}, fixed, extend="changed.nc", **QUIET))
    assert (wider is None) == (name != "as it is")
    if wider is not None:
        xr.testing.assert_equal(wider.isel(Gamma=slice(3)), cube.drop_vars("number"))
