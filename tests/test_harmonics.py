"""The plate as a sum of harmonics: runs of it, what is given in its place, and waveforms from records of accelerations."""

import json
import re
from math import pi

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from dimersweep import ParameterError, Parameters, make, read_declaration, simulate, sweep
from dimersweep.analysis.fits import Waveform
from dimersweep.cli import app
from dimersweep.kernel.model.layout import WAVES
from tests import oracle
from tests.checks.random_scenes import faults, parameters_of, scene_row
from tests.checks.scenes import difference, engine_states, sample_times, sawtooth_scene

jit = pytest.mark.jit
SHAKER = {"z": {1: (0.9, 0.3), 2: (0.027, 1.0), 3: (0.009, 2.0)}, "x": {1: (0.01, 0.4), 2: (0.002, 5.0)}}
SHORT = {"Gamma": 0.9, "phi0": 0.3, "Gamma_2": 0.027, "phi_2": 1.0, "Gamma_3": 0.009, "phi_3": 2.0}
SHORT |= {"Gamma_x": 0.01, "phi_x": 0.4, "Gamma_x_2": 0.002, "phi_x_2": 5.0}


def same_states(one, other):
    xr.testing.assert_identical(
        one.states(np.linspace(0, one.duration, 50)), other.states(np.linspace(0, other.duration, 50))
    )


@jit
def test_a_run_of_harmonics_is_that_of_their_short_forms_to_the_last_bit():
    same_states(simulate(harmonics={"z": {1: (0.9, 0.0)}}, periods=20), simulate(Gamma=0.9, periods=20))
    same_states(simulate(harmonics=SHAKER, periods=20), simulate(**SHORT, periods=20))


@jit
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.release) for k in (2, 3, 4, 5))])
def test_a_saw_tooth_against_the_slow_oracle(seed):
    scene = sawtooth_scene(seed)
    times = sample_times(scene, periods=1)
    expected = oracle.simulate(scene, times, rtol=1e-9, v_rest=1e-8)
    assert expected["status"] == "done"
    states, _ = engine_states(scene, times, 1e-10)
    assert difference(states, expected["samples"][:, 1:]) < 1e-6


@jit
@pytest.mark.parametrize(
    "k", [k if k % 400 == 0 else pytest.param(k, marks=pytest.mark.release) for k in range(0, 4000, 100)]
)
def test_random_plates_leave_no_end_below_them_and_give_no_energy(k):
    """One in a hundred of those that ``benchmarks/evidence/stress.py 4000 --domain harmonics`` examines."""
    assert not faults(parameters_of(scene_row(k, 1, "harmonics")), 10, 1e-8)


@jit
def test_a_run_goes_on_from_a_state_on_the_same_plate():
    """The phases of all harmonics go on with it; those along the plate count from the one along the normal."""
    whole = simulate(harmonics=SHAKER, periods=6, rtol=1e-11)
    t = 2.37 / 15
    later = simulate(start=whole.states(t), periods=3, rtol=1e-11)
    times = np.linspace(0, 2 / 15, 9)
    for name in ("x", "y", "gap_1", "gap_2", "theta"):
        np.testing.assert_allclose(later.states(times)[name], whole.states(t + times)[name], atol=1e-8)


@jit
def test_energy_closes_on_a_plate_of_many_harmonics():
    scene = sawtooth_scene(4)
    assert simulate(**scene, periods=4, rtol=1e-10).energy().closure < 1e-8


# --- files, cubes and the command line --------------------------------------------------------------------------------


@jit
def test_a_waveform_goes_through_files_sweeps_and_the_command_line(tmp_path):
    waveform = Waveform(15.01, SHAKER)
    waveform.save(tmp_path / "plate.toml")
    loaded = Waveform.load(tmp_path / "plate.toml")
    assert loaded.harmonics == {"f": 15.01, **SHAKER}
    expected = simulate(**SHORT, f=15.01, periods=5)
    same_states(simulate(harmonics=loaded, periods=5), expected)
    same_states(simulate(harmonics=tmp_path / "plate.toml", periods=5), expected)
    cube = sweep({"beta0": [0.2, 0.28]}, {"harmonics": str(tmp_path / "plate.toml")}, periods=5, progress=False)
    assert {name: cube[name].item() for name in SHORT} == SHORT and cube["f"] == 15.01
    assert simulate(start=cube.isel(beta0=1)).parameters == simulate(**SHORT, f=15.01, beta0=0.28).parameters
    (tmp_path / "scan.toml").write_text(
        f'[sweep]\nperiods = 5\noutput = "scan.nc"\n[grid]\nbeta0 = [0.2, 0.28]\n[fixed]\nharmonics = "{tmp_path}/plate.toml"\n'
    )
    made = make(read_declaration(tmp_path / "scan.toml"), out=tmp_path / "scan.nc", progress=False)
    assert made.drop_attrs().drop_vars("kernel").equals(cube.drop_attrs().drop_vars("kernel"))
    told = CliRunner().invoke(
        app, ["simulate", "--periods", "5", "--json", "--harmonics", str(tmp_path / "plate.toml")]
    )
    assert told.exit_code == 0, told.output
    parameters = json.loads(told.stdout[told.stdout.index("{") :])["parameters"]
    assert parameters.items() >= SHORT.items() and parameters["f"] == 15.01


def test_harmonics_of_a_file_are_written_by_hand_too(tmp_path):
    path = tmp_path / "by_hand.toml"
    path.write_text('[z]\n1 = [0.9, 0]\n2 = [0.03, "90 deg"]\n')
    assert Parameters(harmonics=path) == Parameters(Gamma=0.9, Gamma_2=0.03, phi_2=pi / 2)
    path.write_text("z = 3")
    with pytest.raises(ParameterError, match=r"^harmonics.z = 3: must be orders and \(intensity, phase\)$"):
        Parameters(harmonics=path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1 = [0.9, 0]\n0 = [0.1, 0]", "harmonics.z.0: must be 1 to 16"),
        ("1 = [0.9, 0]\n17 = [0.1, 0]", "harmonics.z.17: must be 1 to 16"),
        ("1 = [0.9, 0]\n2 = [nan, 0]", "Gamma_2 = nan: must be finite"),
        ("1 = [0.9]", "harmonics.z.1 = [0.9]: must be an intensity and a phase"),
        ("1 = [-0.9, 0]", "Gamma = -0.9: must be >= 0"),
    ],
)
def test_a_waveform_written_by_hand_is_judged(tmp_path, text, told):
    path = tmp_path / "by_hand.toml"
    path.write_text(f"f = 15\n[z]\n{text}\n")
    with pytest.raises(ParameterError, match=rf"^{re.escape(f'{path}: {told}')}$"):
        Waveform.load(path)
    path.write_text('f = 15\n[x]\n1 = [0.1, 0.2]\n[z]\n2 = [0.03, "90 deg"]\n1 = [0.9, 0]\n')
    loaded = Waveform.load(path)
    assert loaded.waves == {"z": {1: (0.9, 0.0), 2: (0.03, pi / 2)}, "x": {1: (0.1, 0.2)}}


TABLES = {
    "commas": "t,z\n" + "{t:.4f},{z:.6f}\n",
    "no head": "{t:.4f} {z:.6f}\n",
    "German": 'Messung 3; Kanal 1\n# 1000 Hz\n"Zeit [s]";"X";"Z [m/s2]"\n' + "{t:.4f};{x:.6f};{z:.6f}\n",
    "tabs": "time\tax\tay\taz\n" + "{t:.4f}\t{x:.6f}\t0.1\t{z:.6f}\n",
    "line of units": "Time,Ch. 1,Ch. 2\n(s),(m/s2),(m/s2)\n\n" + "{t:.4f},{z:.6f},{x:.6f}\n",
}


@pytest.mark.parametrize("kind", TABLES)
def test_the_command_reads_a_record_as_loggers_write_it(tmp_path, coarse_pictures, kind):
    *head, row = TABLES[kind].splitlines(keepends=True)
    z, x = line(15.01, [0.9, 0.03], EVEN), line(15.01, [0.05], EVEN)
    rows = "".join(row.format(t=a, z=b, x=c) for a, b, c in zip(EVEN, z, x, strict=True))
    path, plate = tmp_path / "acc.csv", tmp_path / "plate.toml"
    path.write_text("".join(head) + (rows.replace(".", ",") if kind == "German" else rows))
    how = ["--z", "Ch. 1", "--x", "Ch. 2"] if kind == "line of units" else []
    told = CliRunner().invoke(app, ["waveform", str(path), "--out", str(plate), "--json", *how])
    assert told.exit_code == 0, told.output
    shown = json.loads(told.stdout)
    loaded = Waveform.load(plate)
    assert loaded.f == pytest.approx(15.01, abs=1e-5) and loaded.waves["z"][2][0] == pytest.approx(0.03, abs=1e-3)
    assert ("x" in loaded.waves) == (kind not in ("commas", "no head"))
    assert shown["harmonics"][0]["intensity"] == loaded.waves["z"][1][0] and shown["notes"] == []
    with pytest.raises(
        ParameterError, match=r"must be a \.toml file; of a record, `dimersweep waveform \S+ --out plate\.toml`"
    ):
        Parameters(harmonics=path)
    if kind == "line of units":
        told = CliRunner().invoke(app, ["waveform", str(path), "--plot", str(tmp_path / "p.png"), *how])
        assert re.search(r"^f: 15\.0[01]\d* Hz, error \S+ Hz$", told.output, re.M)
        assert (tmp_path / "p.png").stat().st_size


def test_a_file_that_is_no_record_is_told(tmp_path):
    (path := tmp_path / "acc.csv").write_text("hello\nworld\n")
    with pytest.raises(ParameterError, match=rf"^{path}: has no columns of numbers$"):
        CliRunner().invoke(app, ["waveform", str(path)], catch_exceptions=False)
    path.write_text("t,a,b\n0,1,2\n1,2,3\n")
    with pytest.raises(ParameterError, match=r"has no column z; give --z \(there are t, a, b\)$"):
        CliRunner().invoke(app, ["waveform", str(path)], catch_exceptions=False)


def test_what_a_cube_holds_of_harmonics_that_no_point_has():
    """Nothing: they are not among its coordinates."""
    cube = sweep({"beta0": [0.2]}, periods=1, progress=False)
    higher = {name for wave in WAVES for harmonic in wave for name in harmonic} - {*SHORT, "Gamma_y", "phi_y"} | {
        "Gamma_3"
    }
    assert not higher & {*cube.coords}


# --- waveforms of records ---------------------------------------------------------------------------------------------


def record(f, waves, seconds=10.0, rate=20e3, noise=0.01, seed=0):
    """Times and accelerations along the axes of `waves` [m s-2], of a plate that lies still under gravity."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds * rate)) / rate
    angles = 2 * pi * f * t
    columns = [
        -9.81 * sum(size * np.sin(k * angles + phase) for k, (size, phase) in wave.items()) for wave in waves.values()
    ]
    noises = [noise * 9.81 * next(iter(wave.values()))[0] * rng.normal(size=t.size) for wave in waves.values()]
    return t, np.array(columns).T + np.array(noises).T + 9.81


@pytest.mark.parametrize("seed", range(3))
def test_amplitudes_phases_and_frequency_of_a_record_are_within_their_errors(seed):
    """A sine with 3 % of the second and 1 % of the third harmonic, noise of 1 %, 20 kHz, 10 s, the clock 0.1 % off."""
    phases = np.random.default_rng([seed, 1]).uniform(0, 2 * pi, 3)
    sizes = 0.9 * np.array([1.0, 0.03, 0.01])
    f = 15 * 1.001
    t, a = record(f, {"z": dict(enumerate(zip(sizes, phases, strict=True), start=1))}, seed=seed)
    found = Waveform.fit(t, a[:, 0])
    assert found.f == pytest.approx(f, rel=1e-6)
    assert abs(found.f - f) < 3 * found.errors["f"]
    assert list(found.waves["z"]) == [1, 2, 3]
    for k, (size, phase) in found.waves["z"].items():
        error, phase_error = found.errors["z"][k]
        assert abs(size - sizes[k - 1]) < 3 * error
        off = phase - (phases[k - 1] - k * phases[0])
        assert abs((off + pi) % (2 * pi) - pi) <= 3 * phase_error
    assert found.rest["z"] == pytest.approx(0.009, rel=0.01)


def test_a_record_of_three_axes_in_a_table_of_named_columns():
    """A line that is no harmonic is told as not periodic, and the phases along the plate count from the one along z."""
    t, a = record(15.0, SHAKER, rate=2e3, noise=1e-4)
    a[:, 0] += 0.05 * np.sin(2 * pi * 50.3 * t)
    table = {"time": t, "up": a[:, 0], "along": a[:, 1]}
    found = Waveform.fit("time", table, axes={"x": "along", "z": "up"})
    for axis, wave in SHAKER.items():
        for k, (size, phase) in wave.items():
            shift = k * 0.3 if axis == "z" else 0.0  # SHORT's phases along x count from that along z
            assert found.waves[axis][k][0] == pytest.approx(size, abs=5e-5), (axis, k)
            expected = phase - shift if axis == "z" else phase - k * 0.3
            assert abs((found.waves[axis][k][1] - expected + pi) % (2 * pi) - pi) < 0.03, (axis, k)
    assert found.rest["z"] == pytest.approx(0.05 / 9.81 / 2**0.5, rel=0.02)
    frequencies, densities = found.spectrum
    assert frequencies[densities[1, 0].argmax()] == pytest.approx(50.3, abs=0.1)
    assert Waveform.fit(t, a[:, 0], 15.0).f == 15.0


def test_the_plate_of_a_waveform_moves_as_the_record():
    """From the record on to the plate of a run: the same accelerations, but for a shift in time."""
    t, a = record(15.0, SHAKER, rate=2e3, noise=0.0)
    found = Waveform.fit(t, a, axes=("z", "x"))
    shift = 0.3 / (2 * pi)  # cycles from the start of the record to the start of the waveform
    cycles = 15.0 * t[:200]
    for k, axis in enumerate("zx"):
        np.testing.assert_allclose(found.acceleration(cycles + shift, axis), (a[:200, k] - 9.81) / 9.81, atol=1e-6)


def line(f, sizes, t, seed=0, noise=0.01):
    """Accelerations [m s-2] of a plate with harmonics of these sizes, under gravity, with noise in units of g."""
    turns = 2 * pi * f * t
    noises = noise * np.random.default_rng(seed).normal(size=t.size)
    return 9.81 * (1 - sum(size * np.sin(k * turns + k) for k, size in enumerate(sizes, start=1)) + noises)


EVEN = np.arange(20_000) / 1000  # 20 s at 1 kHz


@pytest.mark.parametrize(
    ("sizes", "other", "f"),
    [
        ([0.5, 0.6], 0.0, None),  # a second harmonic that is stronger than the first one
        ([0.5, 0.6], 0.0, 15.0),
        ([0.5], 50.0, None),  # the mains
        ([0.9, 0.02], 60.0, None),
        ([0.5], 41.3, 15.0),  # of no reason to be the weaker one, but given
    ],
)
def test_the_shakers_line_is_found_beside_stronger_ones(sizes, other, f):
    a = line(15.0, sizes, EVEN) + 9.81 * 0.6 * (other > 0) * np.sin(2 * pi * other * EVEN)
    found = Waveform.fit(EVEN, a, f)
    assert found.f == pytest.approx(15.0, abs=1e-5)
    if other % 15:
        assert [round(each, 3) for each in found.others] == [other]
        assert found.others[next(iter(found.others))]["z"] == pytest.approx(0.6, abs=1e-3)
    else:  # it is a harmonic, too
        assert found.others == {} and (other == 0 or 4 in found.waves["z"])
    for k, size in enumerate(sizes, start=1):
        assert abs(found.waves["z"][k][0] - size) < 4 * found.errors["z"][k][0]


def test_a_line_across_the_plate_is_not_the_shakers():
    a = np.column_stack([line(15.0, [0.9], EVEN), 20 * np.sin(2 * pi * 22.3 * EVEN)])
    found = Waveform.fit(EVEN, a, axes=("z", "x"))
    assert found.f == pytest.approx(15.0, abs=1e-5) and found.waves["z"][1][0] == pytest.approx(0.9, abs=1e-3)
    assert [round(each, 3) for each in found.others] == [22.3] and "another line at 22.3 Hz: 2 g" in repr(found)


@pytest.mark.parametrize("rate", [667, 800, 952, 3200])
@pytest.mark.parametrize("stamp", [lambda t: np.round(t, 3), lambda t: np.floor(1000 * t) / 1000 + 1.7e9])
def test_times_in_whole_milliseconds_are_those_of_an_even_clock(rate, stamp):
    t = np.arange(20 * rate) / rate
    found = Waveform.fit(stamp(t), line(15.0, [0.9, 0.03], t))
    assert abs(found.f - 15.0) < 4 * found.errors["f"] < 4e-4
    assert list(found.waves["z"]) == [1, 2] and found.rest["z"] == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize("places", [9, 3])
def test_samples_that_are_missing_and_steps_that_jitter_do_no_harm(places):
    rng, t = np.random.default_rng(2), np.arange(13_340) / 667
    keep = rng.random(t.size) > 0.02
    found = Waveform.fit(np.round(t, places)[keep], line(15.0, [0.9, 0.03], t)[keep])
    assert abs(found.f - 15.0) < 4 * found.errors["f"] < 4e-4 and found.rest["z"] == pytest.approx(0.01, rel=0.05)
    t = np.cumsum(rng.uniform(0.8, 1.2, t.size)) / 667
    found = Waveform.fit(t, line(15.0, [0.9, 0.03], t))
    assert abs(found.f - 15.0) < 4 * found.errors["f"] < 4e-4 and list(found.waves["z"]) == [1, 2]


def whirling(turns, size=0.9):
    return 9.81 * (size * np.sin(2 * pi * turns) + 0.005 * np.random.default_rng(1).normal(size=EVEN.size))


@pytest.mark.parametrize(
    ("a", "told"),
    [
        (whirling(15 * EVEN, 0.9 * (EVEN < 12.3)), r"the line at 15 Hz stops at t = 12\.[1-4]\d\d s"),
        (whirling(15 * EVEN, 0.9 * (EVEN > 5)), r"the line at 15 Hz begins at t = [45]\.\d+ s"),
        (
            whirling(15 * EVEN, 0.9 * np.clip(EVEN - 2, 0, 1) * np.clip(18 - EVEN, 0, 1)),
            r"the line at 15 Hz begins at t = 2\.\d+ s and stops at t = 17\.\d+ s",
        ),
        (
            whirling(15 * EVEN + 0.05 * np.maximum(EVEN - 9, 0)),
            r"the line at 15\.0\d+ Hz has 15 Hz before t = [89]\.\d+ s and 15\.0\d+ Hz after",
        ),
        (whirling(15 * EVEN + 5 * np.maximum(EVEN - 12, 0)), r"the line at 1[45]\.?\d* Hz stops at t = 1[12]\.\d+ s"),
        (
            whirling(15 * EVEN + 0.02 * EVEN**2),
            r"the line at 15\.\d+ Hz has 15\.[12]\d* Hz before t = \d+\.\d+ s and 15\.[56]\d* Hz after",
        ),
        (
            whirling(15 * EVEN, 0.6 + 0.03 * EVEN),
            r"the line at 15 Hz has 5\.9\d* m/s2 at t = 0\.\d+ s and 11\.7\d* m/s2 at t = 19\.\d+ s",
        ),
    ],
)
def test_a_line_that_does_not_stay_the_same_is_told(a, told):
    with pytest.raises(ParameterError, match=rf"^a \(z\): {told}; give a part in which it stays the same$"):
        Waveform.fit(EVEN, a)


@pytest.mark.parametrize("drift", [3 * EVEN, 50 * np.exp(-EVEN / 3), 50 * np.exp(-EVEN / 0.3)])
def test_a_drift_is_no_harmonic(drift):
    found = Waveform.fit(EVEN, line(15.0, [0.9, 0.03], EVEN) + drift)
    assert list(found.waves["z"]) == [1, 2] and found.rest["z"] == pytest.approx(0.01, rel=0.05)
    for k, size in ((1, 0.9), (2, 0.03)):
        assert abs(found.waves["z"][k][0] - size) < 4 * found.errors["z"][k][0] < 1e-3


def test_a_small_change_of_the_amplitude_is_told_and_no_harm():
    found = Waveform.fit(EVEN, line(15.0, [0.9], EVEN) * (1 + 0.004 * EVEN))
    assert re.fullmatch(
        r"the line at 15 Hz has 8\.8\d* m/s2 at t = \S+ s and 9\.5\d* m/s2 at t = \S+ s", found.notes[-1]
    )
    assert Waveform.fit(EVEN, line(15.0, [0.9], EVEN)).notes == ()


@pytest.mark.parametrize(
    ("a", "told"),
    [
        (np.full(EVEN.size, 9.81), r"has no line, as the acceleration of a shaker has"),
        (line(15.0, [0.0], EVEN, noise=1.0), r"has no line, as the acceleration of a shaker has"),
        (
            line(15.0, [0.1], EVEN, noise=0.1),
            r"0\.\d+ g are left beside the lines, as much as that at 15(\.\d+)? Hz has; must be less",
        ),
    ],
)
def test_a_record_of_noise_is_refused(a, told):
    with pytest.raises(ParameterError, match=rf"^a \(z\): {told}$"):
        Waveform.fit(EVEN, a)


def test_an_accelerometer_that_is_upside_down_lies_on_its_side_or_clips_is_told():
    upright = line(15.0, [1.2, 0.05], EVEN)
    found, expected = Waveform.fit(EVEN, -upright), Waveform.fit(EVEN, upright)
    assert found.waves == expected.waves and expected.notes == ()
    assert found.notes == ("z: the mean is -9.81 m/s2, so the accelerometer was upside down; z is turned over",)
    sideways = np.column_stack([line(15.0, [0.9], EVEN) - 9.81, np.full(EVEN.size, 9.81) + 0.01 * EVEN])
    assert Waveform.fit(EVEN, sideways, axes=("z", "x")).notes[0].endswith(": gravity is along x")
    assert Waveform.fit(EVEN, upright / 9.81).notes == ("z: the mean is 1 m/s2; of a record in units of g, g is 1",)
    assert Waveform.fit(EVEN, upright / 9.81, g=1).waves["z"][1][0] == pytest.approx(1.2, abs=1e-3)
    quantum = 4 * 9.81 / 4096  # of 12 bits over +-2 g
    fine = np.round(upright / quantum) * quantum
    assert Waveform.fit(EVEN, fine).notes == ()
    cut = Waveform.fit(EVEN, np.clip(fine, -19.62, 19.62)).notes
    assert len(cut) == 1 and re.fullmatch(r"z: 1\d\.\d+% of the values are 19\.62 m/s2: its peaks are cut", cut[0])


def test_quantisation_that_repeats_each_period_makes_no_harmonics():
    quantum = 4 * 9.81 / 4096
    found = Waveform.fit(EVEN, np.round(line(20.0, [0.9, 0.03], EVEN, noise=0.0) / quantum) * quantum)
    assert list(found.waves["z"]) == [1, 2]
    assert abs(found.waves["z"][2][0] - 0.03) < 3 * found.errors["z"][2][0]


@pytest.mark.parametrize("kind", ["white", "1/f", "jitter", "random walk of the clock"])
def test_errors_of_frequency_amplitudes_and_phases_are_right_for_each_kind_of_noise(kind):
    """Of 40 records: the deviations have about their errors, and hardly one is beyond three of them."""
    t, off = np.arange(8000) / 800, []
    for seed in range(40):
        rng = np.random.default_rng([seed, 3])
        noise = rng.normal(size=2 * t.size)
        if kind == "1/f":
            noise = np.fft.irfft(np.fft.rfft(noise) / np.sqrt(np.maximum(np.arange(t.size + 1), 1))) * 10
        moved = {"jitter": 5e-5 * noise[: t.size], "random walk of the clock": 2e-6 * np.cumsum(noise[: t.size])}
        f, phase = 15 + rng.uniform(-0.5, 0.5), rng.uniform(0, 2 * pi)
        angle = 2 * pi * f * (t + moved.get(kind, 0.0))
        a = -0.9 * np.sin(angle) - 0.03 * np.sin(2 * angle + phase) + 0.002 * noise[: t.size] * (kind not in moved)
        found = Waveform.fit(t, 9.81 * a + 1e-3 * rng.normal(size=t.size))
        (size, _), (second, turned) = found.waves["z"][1], found.waves["z"][2]
        (error, _), (second_error, turned_error) = found.errors["z"][1], found.errors["z"][2]
        turn = (turned - phase + pi) % (2 * pi) - pi
        off.append(
            [
                (found.f - f) / found.errors["f"],
                (size - 0.9) / error,
                (second - 0.03) / second_error,
                turn / turned_error,
            ]
        )
    assert (np.abs(off) > 3).sum() <= 2
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    assert (spread < 1.35).all() and (kind not in ("white", "1/f", "jitter") or (spread > 0.7).all())


def wrong(**how):
    t, a = record(**({"f": 15.0, "waves": {"z": {1: (0.9, 0.0)}}, "rate": 2e3} | how))
    return t, a[:, 0]


@pytest.mark.parametrize(
    ("t", "a", "f", "told"),
    [
        (*wrong(seconds=1.0), None, r"t: the record holds 15 periods; must be at least 20"),
        (*wrong(rate=60.0), None, r"t: 4 samples a period; must be at least 5"),
        (*wrong(), 20.0, r"f = 20: that of the record is 15\.\d+ Hz; leave f out to take it"),
        (*wrong(f=15.05), 15.0, r"f = 15: that of the record is 15\.\d+ Hz; leave f out to take it"),
    ],
)
def test_a_record_that_does_not_do_is_told(t, a, f, told):
    with pytest.raises(ParameterError, match=f"^{told}$"):
        Waveform.fit(t, a, f)


@pytest.mark.parametrize("t", [-EVEN, 0 * EVEN, np.where(EVEN[9] == EVEN, 5.0, EVEN)])
def test_times_that_do_not_increase_are_told(t):
    with pytest.raises(ParameterError, match=r"^t = \S+ after \S+: the times must increase$"):
        Waveform.fit(t, line(15.0, [0.9], EVEN))
    with pytest.raises(ParameterError, match=r"^a \(z\): has no line, as the acceleration of a shaker has$"):
        Waveform.fit(EVEN[:3], [1.0, 2.0, 3.0])
    with pytest.raises(ParameterError, match=r"^g = -9\.81: must be > 0$"):
        Waveform.fit(EVEN, line(15.0, [0.9], EVEN), g=-9.81)


def test_a_record_with_a_gap_is_told():
    t, a = wrong()
    keep = np.ones(t.size, bool)
    keep[5000:5200] = False
    with pytest.raises(ParameterError, match=r"^t = 2\.6 after 2\.4995: the record has a gap there; give one without$"):
        Waveform.fit(t[keep], a[keep])
    with pytest.raises(ParameterError, match=r"^a \(z\) = nan: must be finite$"):
        Waveform.fit(t, np.where(t == t[3], np.nan, a))
    with pytest.raises(ParameterError, match=r"^axes = \['x'\]: must be one of z, x, y for each column, z among them$"):
        Waveform.fit(t, a, axes=("x",))
