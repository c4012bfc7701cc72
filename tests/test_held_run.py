"""A run that is held: started from a state, gone on with, and what it says of itself."""

import json
from math import nan

import netCDF4
import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep import simulate
from dimersweep.analysis.orbits.slow.fate import Later
from dimersweep.errors import ParameterError, StoreError
from dimersweep.runs import solving
from dimersweep.runs.growth import Lyapunov
from dimersweep.storage.provenance import digest
from tests.checks.data import data

pytestmark = pytest.mark.jit
F = 15.0
SCENES = data("scenes")["held"]


def same_runs(run, other):
    for name in ("status", "mode", "mode_period", "n_events", "n_periods", "parameters", "orbit"):
        assert getattr(run, name) == getattr(other, name), name
    for name in ("down_share_1", "down_share_2", "settled_after"):
        np.testing.assert_equal(getattr(run, name), getattr(other, name))


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("parts", [(1, 59), (40, 20), (25, 25, 10)])
def test_two_parts_are_one_run_bit_for_bit(scene, parts):
    """The state at the start of a period, and what the verdict keeps, is all there is."""
    whole = simulate(**scene, periods=sum(parts))
    run = simulate(**scene, periods=parts[0])
    for more in parts[1:]:
        run = run.go_on(more)
    same_runs(run, whole)
    assert run.events.identical(whole.events)
    times = np.linspace(0, whole.duration, 501)
    assert run.states(times).identical(whole.states(times))


def test_two_parts_of_random_runs_are_one_run():
    """Bit for bit: some were much faster before the cut, by which their impacts are slow, or had chosen a contact there."""
    rng = np.random.default_rng(3)
    for _ in range(250):
        scene = {"e": rng.uniform(0, 0.9), "Gamma": rng.uniform(0.2, 1.3), "f": rng.uniform(8, 40)}
        scene |= {"beta0": rng.uniform(0, 1.5), "xdot0": rng.uniform(-1, 1), "phi0": rng.uniform(0, 6)}
        cut = int(rng.integers(1, 12))
        whole, parts = simulate(**scene, periods=12), simulate(**scene, periods=cut).go_on(12 - cut)
        same_runs(parts, whole)
        events, expected = (run.record("events").events for run in (parts, whole))
        np.testing.assert_array_equal(events, expected, err_msg=str(scene))


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("settle", [False, True])
def test_an_unrecorded_run_goes_on_to_the_same_verdict(scene, settle):
    first = simulate(**scene, periods=90, record=False, stop_when_settled=settle)
    run = first.go_on(30)
    same_runs(run, simulate(**scene, periods=first.n_periods + 30, record=False))


def test_a_closer_look_at_an_unsettled_run_leaves_its_end_alone():
    scene = {"Gamma": 1.9, "beta0": 0.4, "periods": 80}
    run = simulate(**scene)
    assert run.mode in ("aperiodic", "unresolved")  # a twin was followed beyond the end
    longer = run.go_on(5)
    np.testing.assert_array_equal(longer.states(run.duration)["beta"], run.states(run.duration)["beta"])


def test_a_failed_run_does_not_go_on():
    run = simulate(e=1, mu=0, mu_s=0, Gamma=0, f=1e-5, beta0=1e-3, periods=1, record=False)
    assert run.status == "max_events"
    with pytest.raises(ParameterError, match=r"^go_on: the run did not reach its end \(the bound on work"):
        run.go_on(1)
    with pytest.raises(ParameterError, match=r"^periods = 0: must be a whole number >= 1$"):
        simulate(periods=1).go_on(0)
    with pytest.raises(ParameterError, match=r"^periods = 100001: must be <= 100000 for a run whose .* recorded"):
        simulate(periods=1).go_on(100_000)


def test_a_run_starts_from_one_time_of_another():
    base = simulate(periods=60)
    for number in (0, 20, 33):
        start = base.states(number / F)
        again = simulate(start=start, periods=10)
        times = np.linspace(0, 10 / F, 200)
        expected, found = base.states(times + number / F), again.states(times)
        for name in ("x1", "y1", "theta", "beta", "gap_1", "gap_2", "x1_rate", "gamma_rate", "beta_rate"):
            scale = np.abs(expected[name]).max()
            np.testing.assert_allclose(found[name], expected[name], atol=2e-6 * scale, rtol=0, err_msg=name)
    assert again.start is not None and "phase" not in again.start


def test_a_run_starts_within_a_period_at_the_phase_of_the_plate():
    base = simulate(periods=30, rtol=1e-10)
    begin = 20.3 / F
    again = simulate(start=base.states([begin]).isel(time=0), periods=5, rtol=1e-10)
    assert again.parameters["phi0"] == pytest.approx(0.3 * 2 * np.pi, abs=1e-9)
    end = again.states(4 / F)
    expected = base.states(begin + 4 / F)
    for name in ("x", "y", "theta", "beta", "z", "plate"):
        assert end[name].item() == pytest.approx(expected[name].item(), abs=1e-7), name


def test_a_run_starts_where_another_ended_with_another_plate():
    base = simulate(periods=60)
    up = simulate(start=base, Gamma=1.0, periods=200)
    assert (up.mode, up.parameters["Gamma"]) == ("drift", 1.0)
    np.testing.assert_allclose(up.states(0)["theta"], base.states(base.duration)["theta"], rtol=1e-15)


def test_a_state_is_given_by_the_names_of_states():
    level = simulate(start={"gap_1": 1e-3, "theta": 0.3, "x1_rate": 0.1}, periods=1)
    first = level.states(0)
    assert (first["gap_1"].item(), first["gap_2"].item(), first["theta"].item()) == (1e-3, 1e-3, 0.3)
    assert (first["x1_rate"].item(), first["y1_rate"].item()) == (pytest.approx(0.1), pytest.approx(0.0, abs=1e-17))
    down = simulate(start={"beta": -0.2}, periods=1).states(0)  # the lower end is on the plate
    assert (down["gap_2"].item(), down["beta"].item()) == (0.0, -0.2)
    tilted = simulate(start={"beta": "16 deg"}, periods=1).states(0)
    assert tilted["beta"].item() == pytest.approx(np.radians(16), abs=1e-15)
    centred = simulate(start={"x": 1.0, "y": 2.0, "theta": 0.5, "beta": 0.1, "gap_1": 1e-3}, periods=1).states(0)
    assert (centred["x"].item(), centred["y"].item()) == (pytest.approx(1.0), pytest.approx(2.0))
    high = simulate(start={"z1": 0.01, "z1_rate": 0.2, "phase": 1.0}, Gamma=0.5, periods=1).states(0)
    assert high["z1"].item() == pytest.approx(0.01)
    assert high["z1_rate"].item() == pytest.approx(0.2)


def test_the_paper_s_start_is_a_state():
    """p1 on the plate, at rest in space but for the lateral velocity: the plate hits it at once."""
    rise = 0.9 * 9.81 / (2 * np.pi * F)
    usual = simulate(periods=20)
    start = {"beta": 4 * np.pi / 45, "x1_rate": 1.0, "gap_1_rate": -rise}
    same = simulate(start=start, periods=20)
    np.testing.assert_allclose(same.events["time"], usual.events["time"], rtol=1e-9, atol=1e-12)


def test_several_times_are_no_start():
    with pytest.raises(ParameterError, match=r"^start.\w+: has 2 values; give one time, such as"):
        simulate(start=simulate(periods=1).states([0, 0.01]), periods=1)


def test_a_started_run_tells_its_error():
    base = simulate(periods=20)
    bound = simulate(start=base, periods=3).error()
    assert 0 < bound["scaled"].values[-1] < 1e-3


def test_the_section_has_one_point_a_period():
    run = simulate(periods=25)
    section = run.section()
    assert section.sizes == {"n": 26}
    np.testing.assert_array_equal(section["plate"], 0)
    np.testing.assert_array_equal(section["beta"], run.states(np.arange(26) / F)["beta"])


def test_a_cube_tells_how_fast_a_dimer_at_rest_rolls():
    cube = dimersweep.sweep({"Gamma": [0.5, 0.9]}, fixed={"beta0": 0.1}, periods=100, progress=False)
    runs = [simulate(Gamma=Gamma, beta0=0.1, periods=100, record=False) for Gamma in (0.5, 0.9)]
    assert [run.mode for run in runs] == ["rest", "rest"]
    assert cube["speed"].values == pytest.approx([run.end_speed for run in runs], rel=1e-6)
    assert cube["speed"].values.min() > 0.5
    assert "both ends down, moves at 0.7" in repr(runs[0])
    assert "both ends stay down, the centre of mass moves at 0.7" in cube.dimersweep._repr_html_()
    labels = [text.get_text() for text in cube.dimersweep.plot("mode_map").legends[0].get_texts()]
    assert labels == ["rest: both ends down (100.0 %)"]


def test_a_dimer_at_rest_tells_how_fast_it_rolls():
    run = simulate(f=25, beta0=1.535, periods=100)
    assert run.mode == "rest"
    end = run.states(run.duration)
    vx, vy = end["x1_rate"].item(), end["y1_rate"].item()
    assert run.end_speed == pytest.approx(np.hypot(vx, vy), abs=1e-12)
    assert dimersweep.simulate(f=25, beta0=1.535, periods=100, record=False).end_speed == pytest.approx(
        run.end_speed, rel=1e-6
    )


@pytest.mark.parametrize("scene", [{}, {"e_1": 0.5}, {"f": 25, "beta0": 1.535}, {"Gamma": 1.9}])
def test_a_saved_run_comes_back_exactly(tmp_path, scene):
    run = simulate(**scene, periods=40)
    assert run.save(tmp_path / "run.nc") == tmp_path / "run.nc"
    back = dimersweep.load_run(tmp_path / "run.nc")
    same_runs(back, run)
    assert repr(back) == repr(run)
    for name in [name for name in vars(run) if not name.startswith("_")]:
        np.testing.assert_equal(getattr(back, name), getattr(run, name), name)
    assert back.events.identical(run.events)
    times = np.linspace(0, run.duration, 77)
    assert back.states(times).identical(run.states(times))
    same_runs(back.go_on(30), simulate(**scene, periods=70))


@pytest.mark.filterwarnings("ignore:record. is full:RuntimeWarning")
def test_a_saved_run_tells_that_its_record_was_cut(tmp_path, monkeypatch):
    monkeypatch.setattr(solving, "MAX_ROWS", 200)
    run = simulate(periods=30)
    back = dimersweep.load_run(run.save(tmp_path / "run.nc"))
    assert back.record_cut == run.record_cut != ""
    assert repr(back) == repr(run)
    assert back.events.identical(run.events)
    with pytest.raises(ParameterError, match=r"where the record was cut$"):
        back.states(1.9)


def test_a_saved_run_is_read_by_others(tmp_path):
    run = simulate(start={"gap_1": 1e-3, "theta": 0.2}, periods=5)
    run.save(tmp_path / "run.nc")
    plain = xr.open_dataset(tmp_path / "run.nc")
    np.testing.assert_array_equal(plain["time"], run.events["time"])
    assert plain["impulse_1"].attrs["units"] == "N s"
    assert plain["Gamma"].item() == 0.9
    assert plain.attrs["mode"] == run.mode
    assert dimersweep.load_run(tmp_path / "run.nc").start == {"gap_1": 1e-3, "theta": 0.2}


def test_an_unrecorded_run_is_saved_too(tmp_path):
    run = simulate(periods=50, record=False)
    run.save(tmp_path / "run.nc")
    back = dimersweep.load_run(tmp_path / "run.nc")
    same_runs(back.go_on(10), simulate(periods=60, record=False))
    with pytest.raises(ParameterError, match="nothing was recorded"):
        _ = back.events


def test_a_file_that_is_no_run_is_refused(tmp_path):
    run = simulate(periods=2)
    with pytest.raises(ParameterError, match=r"run.txt: a run must end in .nc$"):
        run.save(tmp_path / "run.txt")
    run.save(tmp_path / "run.nc")
    with pytest.raises(StoreError, match=r"exists already"):
        run.save(tmp_path / "run.nc")
    run.save(tmp_path / "run.nc", force=True)
    with pytest.raises(StoreError, match=r"no such file$"):
        dimersweep.load_run(tmp_path / "other.nc")
    with pytest.raises(StoreError, match=r"is a NetCDF file, but no cube of dimersweep$"):
        dimersweep.open_cube(tmp_path / "run.nc")
    xr.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(StoreError, match=r"is a NetCDF file, but no run of dimersweep$"):
        dimersweep.load_run(tmp_path / "other.nc")
    with netCDF4.Dataset(tmp_path / "run.nc", "a") as file:
        file.configuration = file.configuration.replace('"Gamma": 0.9', '"Gamma": 1.9')
    with pytest.raises(StoreError, match=r"was changed or is incomplete$"):
        dimersweep.load_run(tmp_path / "run.nc")


def forged(path, change):
    """Change the configuration of a run's file, with a true checksum."""
    with netCDF4.Dataset(path, "a") as file:
        told = json.loads(file.configuration)
        text = change if isinstance(change, str) else json.dumps(told | change)
        file.setncatts({"configuration": text, "configuration_sha256": digest(text)})


@pytest.mark.parametrize(
    "change",
    [
        "[]",
        "null",
        "{}",
        "[" * 100_000,
        {"parameters": None},
        {"parameters": {"e": 7}},
        {"rtol": "x"},
        {"outcome": {}},
        {"outcome": None},
        {"orbit": [1]},
    ],
    ids=lambda change: str(change)[:30],
)
@pytest.mark.parametrize("record", [True, False])
def test_a_run_with_a_forged_configuration_is_refused(tmp_path, change, record):
    simulate(periods=2, record=record).save(tmp_path / "run.nc")
    forged(tmp_path / "run.nc", change)
    with pytest.raises(
        StoreError, match=r"run.nc: is a run of dimersweep that was changed or is incomplete \([^\n]+\)$"
    ):
        dimersweep.load_run(tmp_path / "run.nc")


def test_a_run_that_an_earlier_version_saved_with_e_beside_the_ends_is_read(tmp_path):
    run = simulate(e_1=0.5, e_2=0.4, periods=2)
    run.save(tmp_path / "run.nc")
    forged(tmp_path / "run.nc", {"parameters": {"e": 0.6, **run.parameters}})
    assert dimersweep.load_run(tmp_path / "run.nc").parameters == run.parameters


def test_a_run_that_an_earlier_version_saved_without_slips_is_read(tmp_path):
    run = simulate(periods=3)
    run.save(tmp_path / "run.nc")
    with xr.open_dataset(tmp_path / "run.nc") as file:
        whole = file.load()
    whole.isel(segment_column=slice(-2)).to_netcdf(tmp_path / "former.nc")
    times = np.linspace(0, 3 / run.parameters["f"], 50)
    former, now = dimersweep.load_run(tmp_path / "former.nc").states(times), run.states(times)
    for name in ("x", "z", "theta", "beta"):
        np.testing.assert_allclose(former[name], now[name], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["end_start", "end_past", "event_rows", "segment_rows"])
@pytest.mark.parametrize("cut", [lambda rows: rows[:, :2], lambda rows: rows.astype("f4"), lambda rows: rows[0]])
def test_a_run_whose_rows_have_another_shape_is_refused_before_the_kernel_reads_beyond_them(tmp_path, name, cut):
    simulate(periods=2).save(tmp_path / "run.nc")
    with xr.open_dataset(tmp_path / "run.nc") as file:
        whole = file.load()
    rows = cut(whole[name].values)
    changed = whole.drop_vars(name).assign({name: ([f"{name}_{k}" for k in range(rows.ndim)], rows)})
    changed.to_netcdf(tmp_path / "cut.nc")
    with pytest.raises(
        StoreError, match=r"cut.nc: is a run of dimersweep that was changed or is incomplete \([^\n]+\)$"
    ):
        dimersweep.load_run(tmp_path / "cut.nc")
    whole.drop_vars(name).to_netcdf(tmp_path / "less.nc")
    if name != "event_rows":  # those of a run that was not recorded
        with pytest.raises(StoreError, match=rf"changed or is incomplete \('{name}'\)$"):
            dimersweep.load_run(tmp_path / "less.nc")


def test_a_run_shows_what_it_is(tmp_path, coarse_pictures):
    run = simulate(periods=60, Gamma=1.0)
    table = run._repr_html_().replace("\N{NO-BREAK SPACE}", " ")
    for word in ("drift", "Γ = 1", "radius", "60 of 0.06667 s"):
        assert word in table
    assert "the centre of mass moves at" in simulate(f=25, beta0=1.535, periods=60)._repr_html_()
    figure = run.plot(tmp_path / "run.png")
    assert len(figure.axes) == 5
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ParameterError, match="nothing was recorded"):
        simulate(periods=1, record=False).plot()


def test_numbers_in_words_have_their_units():
    run = simulate(periods=60)
    assert repr(run.orbit).startswith("<Orbit: radius 4.24472 m, period 36.876 s") and " rad/s, di_end sp_sk>" in repr(
        run.orbit
    )
    assert repr(Lyapunov(0.5, 0.01, 0.03, 200)) == (
        "<Lyapunov: exponent 0.5 /s, error 0.01 /s, 0.03 per forcing period, over 200 of them>"
    )
    assert repr(Later(20.0, 4.5, 300.0, 1.5)) == "<Later: spin 20 rad/s, radius 4.5 m, period 300 s, zeta 1.5 rad>"
    assert repr(Later(0.0, nan, nan, 3.0)) == "<Later: spin 0 rad/s, in a plane, zeta 3 rad>"
    assert repr(Later(nan, nan, nan, nan, "rest")) == "<Later: mode rest>"
    assert "rest, both ends down, moves at 0.725 m/s" in repr(simulate(beta0="10 deg", periods=30))
    assert "rest, both ends down, lies still" in repr(simulate(Gamma=0.5, xdot0=0.0, beta0=0.0, periods=30))
