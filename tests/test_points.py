"""Points that are no grid, and strobes: the same numbers as from a grid or a run, one row a point."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import qmc

import dimersweep
from dimersweep import make
from dimersweep.plots import draw
from dimersweep.studies.declared import read_declaration

pytestmark = pytest.mark.jit
QUIET = {"periods": 120, "progress": False}


def latin(n, seed=1):
    sample = qmc.LatinHypercube(3, seed=seed).random(n)
    return dict(zip(("Gamma", "f", "beta0"), qmc.scale(sample, [0.7, 10, 0.05], [1.2, 30, 1.0]).T, strict=True))


def test_points_have_the_numbers_of_a_grid():
    grid = dimersweep.sweep({"f": [15, 20], "beta0": [0.1, 0.28, 0.5]}, **QUIET)
    table = {"f": [15, 15, 15, 20, 20, 20], "beta0": [0.1, 0.28, 0.5] * 2}
    points = dimersweep.sweep(points=table, **QUIET)
    assert points.sizes == {"point": 6}
    for name in ("mode", "radius", "n_events", "down_share_1"):
        np.testing.assert_array_equal(points[name], grid[name].values.ravel(), err_msg=name)
    np.testing.assert_array_equal(points["f"], table["f"])
    assert points["f"].dims == ("point",)


def test_tables_of_all_kinds_are_taken(tmp_path):
    table = latin(20)
    cube = dimersweep.sweep(points=table, out=tmp_path / "points.nc", **QUIET)
    for same in (pd.DataFrame(table), pd.DataFrame(table).to_xarray(), cube):
        again = dimersweep.sweep(points=same, **QUIET)
        np.testing.assert_array_equal(again["radius"], cube["radius"])
    back = dimersweep.open_cube(tmp_path / "points.nc")
    assert back.drop_attrs().identical(cube.drop_attrs())
    assert dimersweep.sweep(points=table, out=tmp_path / "points.nc", **QUIET).sizes == {"point": 20}


def test_the_workers_do_not_matter():
    one, two = (dimersweep.sweep(points=latin(40), workers=n, **QUIET) for n in (1, 2))
    assert one.drop_attrs().identical(two.drop_attrs())


def test_a_point_has_its_run_and_its_picture():
    cube = dimersweep.sweep(points=latin(30), **QUIET)
    run = cube.dimersweep.run(point=7)
    assert run.parameters["f"] == cube["f"].values[7]
    assert run.mode == dimersweep.names(cube["mode"]).values[7]
    assert len([axes for axes in draw(cube).axes if axes.axison]) == 3
    assert draw(cube, quantity="down_share_1").axes


def test_sensitivity_indices_come_from_points():
    """Sobol indices of the share of time down: an example with SALib; of its axes, the spare one counts for nothing."""
    sample = pytest.importorskip("SALib.sample.sobol", reason="SALib is not installed")
    analyze = pytest.importorskip("SALib.analyze.sobol")
    problem = {"num_vars": 2, "names": ["Gamma", "phi0"], "bounds": [[0.2, 0.9], [0.0, 1e-9]]}
    values = sample.sample(problem, 16, calc_second_order=False, seed=1)
    cube = dimersweep.sweep(points=dict(zip(problem["names"], values.T, strict=True)), periods=20, progress=False)
    found = analyze.analyze(problem, cube["n_events"].values.astype(float), calc_second_order=False, seed=1)
    assert found["ST"][0] > 0.5


def test_strobes_are_the_section_of_the_run_that_goes_on():
    cube = dimersweep.bifurcation(
        {"Gamma": [0.9, 1.9]}, periods=100, strobes=12, progress=False, stop_when_settled=False
    )
    assert cube["strobe_gap_2"].dims == ("Gamma", "strobe")
    for k, Gamma in enumerate((0.9, 1.9)):
        run = dimersweep.simulate(Gamma=Gamma, periods=100, record=False)
        section = dimersweep.simulate(Gamma=Gamma, periods=112).section().isel(n=slice(101, None))
        assert run.mode == dimersweep.names(cube["mode"]).values[k]
        for name in ("gap_1", "gap_2", "theta_rate"):
            # an unrecorded run steps a little differently: chaos tells the two apart soon
            n = 12 if Gamma == 0.9 else 1
            found, expected = cube[f"strobe_{name}"].values[k, :n], section[name].values[:n]
            np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)


def test_a_settled_motion_has_as_many_strobes_as_its_period_and_is_drawn(tmp_path):
    cube = dimersweep.bifurcation(
        {"Gamma": {"start": 0.85, "stop": 1.0, "num": 4}}, periods=200, strobes=8, progress=False, out=tmp_path / "b.nc"
    )
    drift = cube.dimersweep.drifts().values
    assert drift.any()
    assert np.ptp(cube["strobe_gap_2"].values[drift], axis=1).max() < 1e-7
    back = dimersweep.open_cube(tmp_path / "b.nc")
    figure = back.dimersweep.plot()
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "gap of $p_1$ [mm]",
        "gap of $p_2$ [mm]",
        r"$\dot\theta$ [rad/s]",
    ]


def test_a_logarithmic_axis_has_values_in_a_fixed_ratio():
    cube = dimersweep.sweep(
        {"xdot0": {"start": 0.01, "stop": 1, "num": 3, "spacing": "log"}}, periods=2, progress=False
    )
    np.testing.assert_allclose(cube["xdot0"], [0.01, 0.1, 1])


def test_angles_may_be_in_degrees_anywhere():
    degrees = np.deg2rad([10, 20])
    for axis in (["10 deg", "20deg"], {"start": "10 deg", "stop": "20 deg", "num": 2}):
        cube = dimersweep.sweep({"beta0": axis}, periods=1, progress=False)
        np.testing.assert_allclose(cube["beta0"], degrees)
    for held in ("20 deg", {"value": 20, "unit": "deg"}):
        assert dimersweep.sweep({"f": [15]}, {"beta0": held}, periods=1, progress=False)["beta0"].item() == degrees[1]
    assert dimersweep.simulate(beta0="20 deg", periods=1).parameters["beta0"] == degrees[1]


# --- points in a sweep file ---------------------------------------------------------------------------------------------
def declared(tmp_path, points, more=""):
    file = tmp_path / "points.toml"
    file.write_text(f'[sweep]\nperiods = 20\noutput = "points.nc"\n{more}\n{points}\n')
    return read_declaration(file)


def test_a_file_of_points_does_what_sweep_does(tmp_path, monkeypatch):
    table = pd.DataFrame(latin(12))
    table.to_csv(tmp_path / "table.csv", index=False)
    monkeypatch.chdir(tmp_path)
    expected = dimersweep.sweep(points=table, fixed={"mu": 0.15}, periods=20, progress=False)
    lines = "\n".join(f"{name} = {values.tolist()}" for name, values in table.items())
    for points in ('[points]\nfile = "table.csv"', f"[points.columns]\n{lines}"):
        made = make(declared(tmp_path, points, "[fixed]\nmu = 0.15"), None, progress=False)
        assert made.drop_attrs().identical(expected.drop_attrs())


def test_the_command_runs_a_file_of_points_and_makes_its_cube_again(tmp_path, monkeypatch, call):
    monkeypatch.chdir(tmp_path)
    declared(tmp_path, '[points.columns]\nbeta0 = { values = [10, 16], unit = "deg" }\nf = [15, 20]')
    for arguments in (["run", "points.toml"], ["run", "--from", "points.nc", "--out", "again.nc"]):
        assert call(*arguments)[2] == 0
    first, again = map(dimersweep.open_cube, ("points.nc", "again.nc"))
    assert again.drop_attrs().identical(first.drop_attrs())
    assert again.attrs["configuration"] == first.attrs["configuration"]
    np.testing.assert_allclose(first["beta0"], np.deg2rad([10, 16]))
    assert (tmp_path / "points.png").stat().st_size > 1000


def test_a_table_in_a_file_may_have_spaces_blank_lines_and_units(tmp_path):
    (tmp_path / "table.csv").write_text('\ufeff\nf , beta0\n15, 16 deg\n\n20, "0.2"\n', encoding="utf-8")
    columns = declared(tmp_path, '[points]\nfile = "table.csv"').study().grid.columns
    assert {name: values.tolist() for name, values in columns.items()} == {
        "f": [15, 20],
        "beta0": [np.deg2rad(16), 0.2],
    }


@pytest.mark.parametrize("sample", ["random", "latin_hypercube", "sobol"])
def test_points_are_drawn_evenly_from_ranges_and_alike_each_time(tmp_path, sample):
    ranges = '[points.ranges]\nbeta0 = { start = 10, stop = 80, unit = "deg" }\nf = { start = 5, stop = 50, spacing = "log" }'
    first, again, other = (
        declared(tmp_path, f'[points]\nsample = "{sample}"\nnumber = 256\nseed = {seed}\n{ranges}').study().grid.columns
        for seed in (3, 3, 4)
    )
    assert (first["f"] == again["f"]).all() and (first["f"] != other["f"]).any()
    for values, low, high in ((np.rad2deg(first["beta0"]), 10, 80), (np.log(first["f"]), np.log(5), np.log(50))):
        shares = (values - low) / (high - low)
        assert (shares >= 0).all() and (shares <= 1).all()
        counted = np.histogram(shares, 8, (0, 1))[0]
        assert counted.min() > 16 if sample == "random" else (counted == 32).all()


def test_points_drawn_by_ratio_are_the_nearest_floats(tmp_path):
    """So they do not depend on the processor, as the powers of numpy do."""
    mpmath = pytest.importorskip("mpmath")
    section = '[points]\nsample = "random"\nnumber = 500\nseed = 3\n[points.ranges]\n{}'
    even, by_ratio = (
        declared(tmp_path, section.format(f"Gamma = {{ start = {ends}{more} }}")).study().grid.columns["Gamma"]
        for ends, more in (("0.0, stop = 1.0", ""), ("0.3, stop = 7.0", ', spacing = "log"'))
    )
    with mpmath.workdps(50):
        expected = [float(mpmath.mpf(0.3) * (mpmath.mpf(7) / mpmath.mpf(0.3)) ** mpmath.mpf(share)) for share in even]
    assert by_ratio.tolist() == expected
