"""The command line: what it prints, what it writes, and one clear line with exit code 2 for everything else."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import dimersweep
from dimersweep import cli

ROOT = Path(__file__).parents[1]
SMALL = (ROOT / "sweeps" / "fig07-small.toml").read_text()


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(SMALL)


@pytest.fixture
def call(monkeypatch, capsys):
    """Run the command line in this process; what it printed and its exit code."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["dimersweep", *arguments])
        try:
            cli.main()
            code = 0
        except SystemExit as stop:
            code = stop.code
        printed = capsys.readouterr()
        return printed.out, printed.err, code

    return run


def edited(old, new):
    assert old in SMALL
    Path("small.toml").write_text(SMALL.replace(old, new))


def test_run_writes_cube_and_picture_and_tells_lengths(call, fake_kernel):
    out, err, code = call("run", "small.toml")
    assert code == 0, err
    lines = out.splitlines()
    assert lines[0].startswith(("drift ", "rest "))
    assert [line.split(":")[0] for line in lines[1:4]] == ["f = 15 Hz", "f = 20 Hz", "f = 25 Hz"]
    assert lines[4:] == ["cube: fig07-small.nc", "picture: fig07-small.png"]
    assert "132/132 points, 100 %" in err
    assert dimersweep.open_cube("fig07-small.nc").attrs["title"] == "Drift over the initial dip angle (Fig. 7, coarse)"
    assert Path("fig07-small.png").read_bytes().startswith(b"\x89PNG")


def test_options_take_the_place_of_declared_settings(call, fake_kernel):
    _, err, code = call("run", "small.toml", "--out", "x.nc", "--periods", "7", "--rtol", "1e-6", "--no-plot")
    assert code == 0, err
    told = json.loads(dimersweep.open_cube("x.nc").attrs["configuration"])
    assert (told["periods"], told["rtol"]) == (7, 1e-6)
    assert sorted(os.listdir()) == ["small.toml", "x.nc"]


def test_nothing_is_replaced_unless_forced(call, fake_kernel):
    Path("fig07-small.nc").write_text("precious")
    _, err, code = call("run", "small.toml")
    assert code == 2
    assert err.startswith("dimersweep: error: out = fig07-small.nc: exists already;")
    assert Path("fig07-small.nc").read_text() == "precious"
    assert call("run", "small.toml", "--force")[2] == 0
    _, err, code = call("plot", "fig07-small.nc")
    assert (code, err.count("\n")) == (2, 1)
    assert "fig07-small.png: exists already" in err
    assert call("plot", "fig07-small.nc", "--out", "again.pdf")[2] == 0
    assert Path("again.pdf").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "periods =",
            "perods =",
            "sweep.perods: unknown key (allowed: title, periods, rtol, stop_when_settled, output)",
        ),
        ("[plot]", "[plott]", "plott: unknown key (allowed: sweep, grid, fixed, search, refine, paths, plot)"),
        ("periods = 200", "", "sweep.periods: is missing"),
        ("periods = 200", "periods = 0", "sweep.periods = 0: must be a whole number >= 1"),
        ("periods = 200", "periods = 2.5", "sweep.periods = 2.5: must be a valid integer"),
        ("periods = 200", "periods = 200\nrtol = 1", "rtol = 1.0: must be in [1e-13, 0.01]"),
        ('"segments"', '"pie"', "plot.kind = 'pie': must be 'segments', 'mode_map', 'regions'"),
        ("f = [15, 20, 25]", "f = []", "f: the axis is empty; give at least one value"),
        ("f = [15, 20, 25]", "freq = [15]", "freq: unknown parameter (allowed: e, Gamma, f, "),
        ("mu = 0.2", "mu = 0.2\nf = 15", "f: given twice, as an axis and as a fixed value"),
        ("mu = 0.2", "mu = 0.2\nmu = 0.3", "is no valid TOML (Cannot overwrite a value (at line "),
        ("mu = 0.2", "mu = 0.5", "mu_s = 0.4: must be >= mu = 0.5 "),
    ],
)
def test_a_bad_declaration_is_named(call, old, new, message):
    edited(old, new)
    _, err, code = call("run", "small.toml")
    assert code == 2
    assert err.startswith(f"dimersweep: error: small.toml: {message}")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run"], "Missing argument 'SWEEP.toml'."),
        (["run", "absent.toml"], "absent.toml: cannot be read (No such file or directory)"),
        (["run", "small.toml", "--workers", "0"], "workers = 0: must be a whole number >= 1"),
        (["run", "small.toml", "--out", "no/cube.nc"], "out = no/cube.nc: the folder no does not exist"),
        (["run", "small.toml", "--rtol", "1"], "rtol = 1.0: must be in [1e-13, 0.01]"),
        (["plot", "absent.nc"], "absent.nc: no such file"),
        (["plot", "small.toml"], "small.toml: is no NetCDF file, or a damaged one"),
        (["plot", "absent.nc", "--out", "a.xyz"], "out = a.xyz: a picture must end in .png, .pdf, .svg"),
        (["simulate", "--plot", "a.xyz"], "plot = a.xyz: a picture must end in .png, .pdf, .svg"),
        (["simulate", "--e", "fast"], "Invalid value for '--e': 'fast' is not a number"),
        (["simulate", "--periods", "1e3"], "Invalid value for '--periods': '1e3' is not a whole number"),
        (["simulate", "--A_r", "1.5"], "A_r = 1.5: must be >= 2 (below 2 the balls overlap)"),
        (["simulate", "--e", "nan"], "e = nan: must be finite"),
        (["simulate", "--periods", "0"], "periods = 0: must be a whole number >= 1"),
        (["simulate", "--alpha", "1"], "No such option: --alpha"),
        (["dance"], "No such command 'dance'."),
    ],
)
def test_a_bad_call_is_one_line_and_exit_code_2(call, arguments, message):
    out, err, code = call(*arguments)
    assert code == 2
    assert err.startswith(f"dimersweep: error: {message}")
    assert (out, err.count("\n")) == ("", 1)


def test_simulate_prints_a_short_table(call):
    out, err, code = call("simulate", "--periods", "60", "--mu_s", "0.4")
    assert code == 0, err
    for word in ("status", "ok", "mode", "drift", "radius", "zeta", "sp_sk"):
        assert word in out
    assert len(out.splitlines()) < 25


def test_simulate_prints_json_and_draws(call):
    out, err, code = call("simulate", "--periods", "60", "--json", "--plot", "run.png")
    assert code == 0, err
    told = json.loads(out)
    assert (told["status"], told["mode"], told["orbit"]["di_end"]) == ("ok", "drift", "sp_sk")
    assert told["orbit"]["radius"] == pytest.approx(4.2447, rel=1e-3)
    assert Path("run.png").read_bytes().startswith(b"\x89PNG")


def test_help_and_version_answer_at_once():
    for option in ("--help", "--version"):
        times = []
        for _ in range(3):
            start = time.perf_counter()
            done = subprocess.run(
                [sys.executable, "-m", "dimersweep", option],
                capture_output=True,
                text=True,
                check=True,
                cwd=ROOT,
            )
            times.append(time.perf_counter() - start)
        assert min(times) < 0.5, times
        assert "dimersweep" in done.stdout


SLOW_SWEEP = """
import sys, time
import dimersweep.tiles
dimersweep.tiles.run_many = lambda rows, *rest: time.sleep(0.3 * len(rows))
from dimersweep.cli import main
sys.argv = ["dimersweep", "run", "small.toml"]
print("ready", flush=True)
main()
"""


def test_ctrl_c_stops_a_sweep_within_two_seconds(tmp_path):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", SLOW_SWEEP], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(2.5)
        process.send_signal(signal.SIGINT)
        start = time.perf_counter()
        _, err = process.communicate(timeout=20)
    assert time.perf_counter() - start < 2
    assert process.returncode == 130
    assert err.splitlines()[-1] == "dimersweep: interrupted, nothing was written"
    assert os.listdir() == ["small.toml"]
