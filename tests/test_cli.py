"""The command line: what it prints, what it writes, and one clear line with exit code 2 for everything else."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from itertools import pairwise
from math import isnan
from pathlib import Path

import pytest

import dimersweep
from dimersweep import cli
from dimersweep.cli.options import in_lines
from dimersweep.kernel.model.layout import ORBIT_COLUMNS, ROW, ROW_BETA0, RUN_COLUMNS
from dimersweep.plots.movie import MOVIES
from dimersweep.plots.style import PICTURES
from dimersweep.storage.outputs import CUBES, TABLES
from dimersweep.studies.study import MOST_PARTS
from dimersweep.symbols import BASE, conditions
from tests.checks.data import data, is_told
from tests.fakes import failing, fake_run_many, interrupts, points_on_disk, raising
from tests.seams import another_version, exit_plainly, no_work, use_kernel

ROOT = Path(__file__).parents[1]
SMALL = (ROOT / "sweeps" / "fig07-small.toml").read_text()


@pytest.fixture(autouse=True)
def in_an_empty_folder(empty_folder, coarse_pictures):
    Path("small.toml").write_text(SMALL)


@pytest.fixture
def refused(call):
    """Run a command that is refused in a line, or in so many, and prints nothing before; what is said."""

    def run(*arguments, lines=1, silent=True):
        out, err, code = call(*arguments)
        assert (code, err.count("\n")) == (2, lines), err
        assert not (silent and out)
        assert err.startswith("dimersweep: error: ")
        return err.removeprefix("dimersweep: error: ").removesuffix("\n")

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


def test_options_take_the_place_of_declared_settings(done, fake_kernel):
    done("run", "small.toml", "--out", "x.nc", "--periods", "7", "--rtol", "1e-6", "--no-plot")
    told = json.loads(dimersweep.open_cube("x.nc").attrs["configuration"])
    assert (told["periods"], told["rtol"]) == (7, 1e-6)
    assert sorted(os.listdir()) == ["small.toml", "x.nc"]


def test_nothing_is_replaced_unless_forced(done, refused, fake_kernel):
    Path("fig07-small.nc").write_text("precious")
    told = refused("run", "small.toml")
    assert told.startswith("out = fig07-small.nc: exists already, and cannot be used (fig07-small.nc: is no")
    assert "(--force)" in told
    assert Path("fig07-small.nc").read_text() == "precious"
    done("run", "small.toml", "--force")
    assert "fig07-small.png: exists already" in refused("plot", "fig07-small.nc")
    done("plot", "fig07-small.nc", "--out", "again.pdf")
    assert Path("again.pdf").exists()


@pytest.mark.parametrize(("command", "told"), data("refusals")["commands"].items())
def test_a_bad_call_is_one_line_and_exit_code_2(refused, monkeypatch, command, told):
    monkeypatch.setattr("dimersweep.work.scheduling.CONNECT_SECONDS", 0.5)
    assert is_told(refused(*command.split()), told)


def test_simulate_prints_a_short_table(done):
    out = done("simulate", "--periods", "60", "--mu_s", "0.4")
    for word in ("status", "ok", "mode", "drift", "radius", "zeta", "sp_sk"):
        assert word in out
    assert len(out.splitlines()) < 25


def test_simulate_prints_json_and_draws(call, done):
    out = done("simulate", "--periods", "60", "--json", "--plot", "run.png")
    told = json.loads(out)
    assert (told["status"], told["mode"], told["orbit"]["di_end"]) == ("ok", "drift", "sp_sk")
    assert told["orbit"]["radius"] == pytest.approx(4.2447, rel=1e-3)
    assert Path("run.png").read_bytes().startswith(b"\x89PNG")
    run = dimersweep.simulate(periods=60)
    numbers = [None if isnan(getattr(run, name)) else getattr(run, name) for name in RUN_COLUMNS]
    assert [told[name] for name in RUN_COLUMNS] == numbers
    assert told["track"] == "arc"
    assert [told["orbit"][name] for name in ORBIT_COLUMNS] == [getattr(run.orbit, name) for name in ORBIT_COLUMNS]
    told = json.loads(call("simulate", "--Gamma", "0.5", "--json")[0])
    assert (told["mode"], told["settled_after"], told["orbit"]) == ("rest", None, None)


def test_simulate_takes_the_distance_of_the_balls(call):
    told = json.loads(call("simulate", "--l", "0.05", "--beta0", "16 degrees", "--periods", "1", "--json")[0])
    assert told["parameters"]["A_r"] == 6
    words = " ".join(call("simulate", "--help")[0].replace("│", " ").split())
    assert "--l NUMBER distance between the centres of the balls, in place of A_r (m, or 2mm)" in words


def test_simulate_takes_values_of_single_ends(call, refused):
    told = json.loads(call("simulate", "--e_1", "0.5", "--e", "0.7", "--periods", "1", "--json")[0])
    assert told["parameters"].items() >= {"e_1": 0.5, "e_2": 0.7}.items()
    told = json.loads(call("simulate", "--e_1", "0.5", "--e_2", "0.4", "--periods", "1", "--json")[0])
    assert "e" not in told["parameters"]
    assert (
        refused("simulate", "--e", "0.6", "--e_1", "0.5", "--e_2", "0.4")
        == "e: has no effect beside e_1 and e_2; leave one of the three out"
    )


def test_simulate_tells_its_conditions(done):
    out = done("simulate", "--periods", "2", "--e_1", "0.5", "--g", "9")
    told = out.splitlines()[0].replace("\N{NO-BREAK SPACE}", " ")
    assert "A_r = 6, e_1 = 0.5, e_2 = 0.6, Γ = 0.9" in told and told.endswith("g = 9 m/s²")


HEAVY = {"numba", "numpy", "xarray", "dask", "distributed", "matplotlib", "scipy", "pandas", "netCDF4", "pydantic"}


def loaded_by(program):
    """What a Python process prints, and the packages that it has loaded at its end."""
    told = "import sys, atexit; atexit.register(lambda: print(*(n for n in sys.modules if '.' not in n), sep='\\n'))\n"
    done = subprocess.run([sys.executable, "-c", told + program], capture_output=True, text=True, check=True, cwd=ROOT)
    return done.stdout, set(done.stdout.split())


def test_a_package_of_another_version_is_told_in_a_line(call, monkeypatch):
    def refuse(**given):
        raise ImportError("Numba needs NumPy 2.2 or less. Got NumPy 2.4.")

    monkeypatch.setattr("dimersweep.runs.simulating.simulate", refuse)
    _, err, code = call("simulate")
    assert code == 2
    told = "cannot run with the packages and settings that there are (Numba needs NumPy 2.2 or less. Got NumPy 2.4.)"
    assert err.splitlines()[-1] == f"dimersweep: error: {told}"


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_answer_without_the_heavy_packages(option):
    printed, loaded = loaded_by(f"sys.argv = ['dimersweep', '{option}']\nfrom dimersweep.cli import main\nmain()")
    assert "dimersweep" in printed and "typer" in loaded
    assert not HEAVY & loaded


def test_an_import_leaves_the_heavy_packages_for_later():
    _, loaded = loaded_by("import dimersweep")
    assert "dimersweep" in loaded and not (HEAVY | {"typer", "rich"}) & loaded


SMALL_MAP = (ROOT / "sweeps" / "fig08-small.toml").read_text()
SLOW_SWEEP = """
import sys, time
import dimersweep.runs.solving
import dimersweep.studies.making
from tests.fakes import fake_run_many

def slow(rows, *rest, until=0, space=None):
    time.sleep(0.05 * len(rows))
    return fake_run_many(rows, *rest)

dimersweep.runs.solving.run_many = slow
dimersweep.studies.making.prepare_kernel = lambda progress: None  # nothing runs on it
from dimersweep.cli import main
sys.argv = ["dimersweep", "run", sys.argv[1], "--workers", "2"]
print("ready", flush=True)
main()
"""


@contextmanager
def slow_sweep(declared="small.toml", cube="fig07-small.nc"):
    """A process at work on a sweep of some seconds, once it has put points on the disk."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", SLOW_SWEEP, declared],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout.readline() == "ready\n"
            give_up = time.monotonic() + 120
            while not points_on_disk(Path(cube)):
                assert time.monotonic() < give_up and process.poll() is None
                time.sleep(0.02)
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("declared", "cube", "number", "word"),
    [
        ("small.toml", "fig07-small.nc", signal.SIGINT, "interrupted"),
        pytest.param("small.toml", "fig07-small.nc", signal.SIGTERM, "terminated", marks=pytest.mark.release),
        ("map.toml", "fig08-small.nc", signal.SIGINT, "interrupted"),
    ],
)
def test_a_signal_stops_a_sweep_or_a_map_and_it_goes_on(call, fake_kernel, declared, cube, number, word):
    Path("map.toml").write_text(SMALL_MAP)
    with slow_sweep(declared, cube) as process:
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    points = r"points known to be needed so far" if declared == "map.toml" else "points"
    kept = rf"(\d+) of (\d+) {points} are kept in {cube}.tiles; run the same again to go on"
    done, size = re.fullmatch(f"dimersweep: {word}: {kept}", err.splitlines()[-1]).groups()
    assert 0 < int(done) < int(size) and (declared == "map.toml" or size == "132")
    assert sorted(os.listdir()) == [f"{cube}.tiles", "map.toml", "small.toml"]
    assert call("status", cube)[0].startswith(f"{cube}: {done} of {size} {points}")
    _, err, code = call("run", declared, "--no-plot")
    assert code == 0, err
    assert f"going on: {done} of {size}" in err or (declared == "map.toml" and f"going on: {done} of " in err)
    assert sorted(os.listdir()) == [cube, "map.toml", "small.toml"]


ENDLESS = """
import sys
import dimersweep.kernel.batch as batch

run_rows = batch.run_rows

def told(rows, starts, ask, *rest):
    if ask.periods == 10**9:
        sys.stdout.write("ready\\n")  # at once: two threads come here
        sys.stdout.flush()
    return run_rows(rows, starts, ask, *rest)

batch.run_rows = told
"""
ENDLESS_COMMAND = """
from dimersweep.cli import main
sys.argv = ["dimersweep", "simulate", "--periods", "1000000000"]
main()
"""
ENDLESS_CALL = """
import dimersweep
dimersweep.simulate(periods=10**9, record=False)
"""
ENDLESS_SWEEP = """
import dimersweep
dimersweep.sweep({"beta0": [0.28, 0.3]}, periods=10**9, stop_when_settled=False, progress=False)
"""


@pytest.mark.jit
@pytest.mark.parametrize(
    ("program", "code"),
    [
        (ENDLESS_COMMAND, 130),
        (ENDLESS_CALL, -signal.SIGINT),
        pytest.param(ENDLESS_SWEEP, 1, marks=pytest.mark.release),
    ],
)
def test_a_signal_ends_a_run_of_weeks(program, code):
    with subprocess.Popen(
        [sys.executable, "-c", ENDLESS + program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout.readline() == "ready\n"
            time.sleep(0.3)  # until it is in compiled code
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == code, err
    assert ("Traceback" in err) == (code != 130)


@pytest.mark.jit
def test_a_bound_on_the_time_of_a_run(call, refused):
    for seconds in ("0.02", "0.2", "2", "20"):  # until it has come somewhere
        out, _, code = call("simulate", "--periods", "1000000000", "--max-seconds", seconds, "--json")
        told = json.loads(out)
        assert (code, told["status"], told["mode"]) == (0, "stopped", "failed")
        if told["n_periods"]:
            break
    assert 0 < told["n_periods"] < 10**9
    assert refused("simulate", "--max-seconds", "0") == "max_seconds = 0.0: must be > 0"


@pytest.fixture
def interrupted_in(call, monkeypatch):
    """Run a command that Ctrl-C stops in a function; the line that it ends with."""

    def run(where, *arguments):
        with monkeypatch.context() as patch:
            patch.setattr(where, interrupts)
            exit_plainly(patch)
            _, err, code = call(*arguments)
        assert code == 130
        return err.splitlines()[-1]

    return run


# of each command: its arguments, and places where a signal may find it
COMMANDS = {
    "simulate": (["--periods", "3"], ["parameters.Parameters", "runs.simulating.simulate"]),
    "run": (["small.toml"], ["studies.declared.read_declaration", "studies.making.make_cube"]),
    "merge": (["absent.nc", "--out", "a.nc"], ["studies.merging.merge"]),
    "presets": ([], ["cli.sweeping.all_presets"]),
    "plan": (["small.toml"], ["studies.declared.read_declaration", "studies.planning.plan"]),
    "status": (["absent.nc"], ["studies.status.status"]),
    "plot": (["absent.nc", "--out", "a.png"], ["plots.check_picture", "storage.cubefiles.open_result"]),
    "explore": (["absent.nc"], ["storage.cubefiles.open_result"]),
    "borders": (["small.toml"], ["analysis.borders.border_files.read_borders"]),
    "orbits": ([], ["analysis.orbits.sustained"]),
    "attractors": (["beta0=0.1:0.5"], ["analysis.attractors.shares.attractors"]),
    "later": (["--spin", "110", "--seconds", "1h"], ["analysis.orbits.find", "analysis.orbits.later"]),
    "lyapunov": ([], ["runs.simulating.simulate", "runs.growth.lyapunov"]),
    "power": (["--before", "5", "--periods", "5"], ["runs.simulating.simulate"]),
    "fit": (["absent.csv", "e=0.5:0.7"], ["inputs.read_text"]),
    "warm": ([], ["work.computing.prepare_kernel"]),
    "waveform": (["absent.csv"], ["inputs.read_text"]),
}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_every_command_in_one_way(call, monkeypatch, number):
    """Wherever it is, with one line and the exit code that a shell expects of that signal."""
    assert COMMANDS.keys() == {one.callback.__name__ for one in cli.app.registered_commands}
    exit_plainly(monkeypatch)
    word = "interrupted" if number == signal.SIGINT else "terminated"
    for name, (arguments, places) in COMMANDS.items():
        for place in places:
            with monkeypatch.context() as patch:
                patch.setattr(f"dimersweep.{place}", lambda *rest, **more: signal.raise_signal(number))
                out, err, code = call(name, *arguments)
            told = f"dimersweep: {word}: nothing was written"
            assert (out, err.splitlines()[-1:], code) == ("", [told], 128 + number), (name, place)
    assert os.listdir() == ["small.toml"]


def test_ctrl_c_ends_a_server_as_it_ends_all_else(call, monkeypatch):
    exit_plainly(monkeypatch)
    monkeypatch.setattr("dimersweep.exploring.serving.Explorer.wait", lambda self: signal.raise_signal(signal.SIGINT))
    out, err, code = call("explore", "--no-show", "--port", "0")
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/ \(Ctrl-C ends it\)\n", out)
    assert (err, code) == ("dimersweep: interrupted: nothing was written\n", 130)


@pytest.mark.parametrize("port", ["80000", "65536", "-1", "99999999999999999999"])
def test_a_port_that_cannot_be_is_refused_at_once(refused, port):
    assert refused("explore", "absent.nc", "--port", port) == f"port = {port}: must be 0 to 65535"


def printed_to(target, arguments, **settings):
    """Exit code, and the lines of the error output, of a command that prints to a file, or to a pipe that is closed."""
    given = os.environ | {"PYTHONPATH": str(ROOT)} | settings
    command = [sys.executable, "-m", "dimersweep", *arguments]
    if target == "closed pipe":
        far, near = os.pipe()
        os.close(far)
        stream = os.fdopen(near, "wb")
    else:
        stream = open(target, "wb")  # noqa: SIM115
    with stream:
        done = subprocess.run(command, stdout=stream, stderr=subprocess.PIPE, env=given, text=True, check=False)
    return done.returncode, done.stderr.splitlines()


@pytest.mark.parametrize("arguments", [["presets", "fig07"], ["simulate", "--help"]], ids=" ".join)
def test_what_cannot_be_printed_to_a_full_disk_or_a_closed_pipe_is_no_traceback(arguments):
    refused = ["dimersweep: error: what is printed: No space left on device"]
    assert printed_to("/dev/full", arguments) == (2, refused)
    assert printed_to("closed pipe", arguments) == (1, [])


@pytest.mark.jit
def test_a_table_is_printed_in_the_letters_that_the_terminal_has():
    code, told = printed_to("out.txt", ["simulate", "--periods", "3"], PYTHONIOENCODING="latin-1")
    text = Path("out.txt").read_bytes().decode("latin-1")
    assert (code, [line for line in told if "compil" not in line]) == (0, [])
    assert "\\u0393" in text.splitlines()[0] and "forcing periods" in text


@pytest.mark.parametrize("width", [20, 40, 60, 79, 80, 81, 200])
def test_a_terminal_breaks_no_number_in_two(monkeypatch, width):
    told = conditions(BASE | {"g": 9.0, "Gamma_2": 0.1, "phi_2": 0.3})
    monkeypatch.setenv("COLUMNS", str(width))
    assert in_lines(told) == told  # what is no terminal breaks nothing
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    lines = in_lines(told).splitlines()
    assert max(map(len, lines)) <= width
    assert ", ".join(line.removesuffix(",") for line in lines) == told
    assert len(lines) == 1 or all(
        len(line) + 1 + len(after.partition(", ")[0]) >= width for line, after in pairwise(lines)
    )


def test_a_file_with_the_mark_of_some_editors_is_read(call, done, fake_kernel):
    Path("small.toml").write_bytes(b"\xef\xbb\xbf" + SMALL.encode())
    done("run", "small.toml", "--no-plot")
    assert call("presets", "./small.toml")[0].startswith("# ") == SMALL.startswith("# ")
    assert "\ufeff" not in call("presets", "./small.toml")[0]


UNREADABLE = {
    "folder.toml": "cannot be read (Is a directory)",
    "latin.toml": "is no text in UTF-8 ('utf-8' codec can't decode byte 0xe9 in position 1: ",
    "wide.toml": "is no text in UTF-8 ('utf-8' codec can't decode byte 0xff in position 0: ",
    "loop.toml": "cannot be read (Too many levels of symbolic links)",
    "absent.toml": "cannot be read (No such file or directory)",
}


@pytest.mark.parametrize("command", ["run", "plan", "borders", "presets"])
def test_a_file_that_is_no_text_is_refused_in_a_line(refused, command):
    Path("folder.toml").mkdir()
    Path("latin.toml").write_bytes("#é\n".encode("latin-1"))
    Path("wide.toml").write_bytes(SMALL.encode("utf-16"))
    Path("loop.toml").symlink_to("loop.toml")
    for name, told in UNREADABLE.items():
        assert refused(command, name).startswith(f"{name}: {told}"), name
    assert "File name too long" in refused(command, "x" * 300)


@pytest.mark.jit
def test_a_run_that_is_stopped_says_which_files_are_written(interrupted_in):
    said = interrupted_in("dimersweep.Run.animate", "simulate", "--periods", "3", "--plot", "a.png", "--movie", "a.gif")
    assert said == "dimersweep: interrupted: a.png written, a.gif not; run the same again with --force for the rest"
    assert sorted(os.listdir()) == ["a.png", "small.toml"]
    said = interrupted_in("dimersweep.Run.plot", "simulate", "--periods", "3", "--plot", "a.png", "--force")
    assert said == "dimersweep: interrupted: nothing was written"


def test_a_sweep_that_is_stopped_says_what_is_kept_wherever_it_is(done, fake_kernel, interrupted_in):
    there = "are kept in fig07-small.nc.tiles; run the same again to go on"
    for _ in range(2):  # the second time all points are there
        said = interrupted_in("dimersweep.studies.making.write_cube", "run", "small.toml")
        assert said == f"dimersweep: interrupted: 132 of 132 points {there}"
    said = interrupted_in("dimersweep.studies.making.make_cube", "run", "small.toml")
    assert said == f"dimersweep: interrupted: what was finished is kept in{there.removeprefix('are kept in')}"
    said = interrupted_in("dimersweep.storage.store.Store.remove", "run", "small.toml", "--no-plot")
    assert said == "dimersweep: interrupted: fig07-small.nc is written"
    Path("fig07-small.nc").unlink()
    said = interrupted_in("dimersweep.plots.draw", "run", "small.toml")
    written = "fig07-small.nc written, fig07-small.png not; run the same again for the rest"
    assert said == f"dimersweep: interrupted: {written}"
    done("run", "small.toml")
    assert sorted(os.listdir()) == ["fig07-small.nc", "fig07-small.png", "small.toml"]


def test_two_sweeps_do_not_share_a_store_and_status_names_the_holder(call, done, refused, fake_kernel):
    with slow_sweep() as process:
        told = refused("run", "small.toml")
        assert told.startswith(f"fig07-small.nc.tiles: a sweep is at work here (process {process.pid} on ")
        out, err, code = call("status", "fig07-small.nc")
        assert (err, code) == ("", 0)
        assert f"at work: process {process.pid} on " in out
        process.kill()
        process.wait()
    assert "at work: nobody; run the same sweep again to go on" in call("status", "fig07-small.nc")[0]
    done("run", "small.toml", "--no-plot")


def test_another_configuration_is_refused_with_what_differs(call, fake_kernel, interrupted_in):
    interrupted_in("dimersweep.studies.making.write_cube", "run", "small.toml")
    _, err, code = call("run", "small.toml", "--periods", "300", "--rtol", "1e-6")
    assert code == 2
    assert err.splitlines() == [
        "dimersweep: error: fig07-small.nc.tiles: holds results of other settings, stopped before the end; begin anew "
        "with --force, or give another output. What differs:",
        "  periods: 200 -> 300",
        "  rtol: 1e-08 -> 1e-06",
    ]
    _, err, code = call("run", "small.toml", "--periods", "300", "--force", "--no-plot")
    assert (code, "going on" in err) == (0, False)
    assert json.loads(dimersweep.open_cube("fig07-small.nc").attrs["configuration"])["periods"] == 300


def test_a_finished_sweep_is_not_done_again(call, done, refused, fake_kernel, monkeypatch):
    done("run", "small.toml", "--no-plot")
    no_work(monkeypatch)
    for _ in range(2):  # first without a picture, then with one
        out, err, code = call("run", "small.toml")
        assert (code, err) == (0, "fig07-small.nc: is complete already; nothing was run\n")
        assert out.splitlines()[-2:] == ["cube: fig07-small.nc", "picture: fig07-small.png"]
    told = refused("run", "small.toml", "--rtol", "1e-6", "--no-plot", lines=2)
    assert told.splitlines()[1:] == ["  rtol: 1e-08 -> 1e-06"]


def test_a_picture_that_is_not_of_this_sweep_stays(call, done, refused, fake_kernel):
    done("run", "small.toml", "--periods", "100", "--out", "other.nc")
    for precious in (Path("other.png").read_bytes(), b"precious"):
        Path("fig07-small.png").write_bytes(precious)
        assert refused("run", "small.toml").startswith("picture = fig07-small.png: exists already; give another name")
        assert Path("fig07-small.png").read_bytes() == precious
    Path("fig07-small.png").unlink()
    done("run", "small.toml", "--no-plot")
    Path("fig07-small.png").write_bytes(b"precious")
    _, err, code = call("run", "small.toml")  # the cube is there: a picture that cannot be drawn is no failure
    assert (code, err.splitlines()[-1].startswith("dimersweep: warning: fig07-small.png: was not drawn (")) == (0, True)
    assert Path("fig07-small.png").read_bytes() == b"precious"


THREE_AXES = SMALL.replace("f = [15, 20, 25]", "f = [15, 20]\nA_r = [5, 6]").replace("A_r = 6\n", "")


def test_three_axes_without_a_plot_section_are_drawn_as_panels(call, fake_kernel):
    Path("small.toml").write_text(THREE_AXES.partition("[plot]")[0])
    out, err, code = call("run", "small.toml")
    assert (code, "warning" in err) == (0, False)
    assert out.splitlines()[-1] == "picture: fig07-small.png"


@pytest.mark.parametrize(
    ("declared", "kind", "message"),
    [
        (THREE_AXES, "segments", "segments: has axes f, A_r, beta0; draws 1 to 2 of them"),
        (SMALL.replace("beta0", "phi0"), "segments", "segments: has axes f, phi0; needs beta0 among them"),
        (SMALL, "trends", "trends: has axes beta0, f; needs A_r, f"),
        (SMALL, "regions", "regions: needs the regions of a search over two axes"),
        (SMALL, "paths", "paths: the cube has no paths over one axis; declare [paths]"),
    ],
)
def test_a_picture_that_cannot_be_is_told_of_before_the_sweep(done, refused, fake_kernel, declared, kind, message):
    Path("small.toml").write_text(declared.replace('"segments"', f'"{kind}"'))
    assert refused("run", "small.toml") == f"plot.kind = '{kind}': {message}; another kind, or --no-plot"
    assert os.listdir() == ["small.toml"]
    done("run", "small.toml", "--no-plot")
    assert Path("fig07-small.nc").exists()


def test_a_picture_that_fails_takes_nothing_from_the_success(call, fake_kernel, monkeypatch):
    monkeypatch.setattr("dimersweep.plots.draw", lambda *rest, **more: 1 / 0)
    out, err, code = call("run", "small.toml")
    assert (code, out.splitlines()[-1]) == (0, "cube: fig07-small.nc")
    assert err.splitlines()[-1] == "dimersweep: warning: fig07-small.png: was not drawn (division by zero)"


def test_plot_takes_a_kind_a_quantity_and_a_selection(done, refused, fake_kernel):
    Path("small.toml").write_text(THREE_AXES.partition("[plot]")[0])
    done("run", "small.toml", "--no-plot")
    for more in (["--select", "A_r=5"], ["--quantity", "radius"], ["--select", "A_r=5", "--kind", "segments"]):
        done("plot", "fig07-small.nc", *more, "--force")
    assert "e is no axis of the cube (f, A_r, beta0)" in refused("plot", "fig07-small.nc", "--select", "e=1", "--force")
    assert "beta0 = 16: must lie on the axis" in refused("plot", "fig07-small.nc", "--select", "beta0=16", "--force")
    assert (
        refused("plot", "fig07-small.nc", "--kind", "trends", "--force", silent=False)
        == "trends: has axes A_r, beta0, f; needs A_r, f"
    )


def test_an_output_has_the_ending_of_its_format(refused, fake_kernel):
    assert refused("run", "small.toml", "--out", "a.csv") == "out = a.csv: a cube must end in .nc or .zarr"


def test_no_two_kinds_of_output_have_an_ending_in_common():
    kinds = CUBES, PICTURES, MOVIES
    assert len({ending for endings in kinds for ending in endings}) == sum(map(len, kinds))
    assert set(TABLES) < set(CUBES)


def test_a_picture_never_replaces_the_cube_that_it_is_of(done, refused, fake_kernel):
    done("run", "small.toml", "--no-plot")
    Path("fig07-small.nc").rename("cube.png")
    before = Path("cube.png").read_bytes()
    assert refused("plot", "cube.png", "--force") == "out = cube.png: would replace what is read; give another name"
    assert Path("cube.png").read_bytes() == before


def test_python_errors_speak_python(done, refused, fake_kernel):
    done("run", "small.toml", "--no-plot")
    with pytest.raises(dimersweep.StoreError, match=r"\(force=True\)"):
        dimersweep.sweep({"f": [15]}, periods=1, out="fig07-small.nc")
    told = refused("run", "small.toml", "--periods", "3", "--no-plot", lines=2)
    assert "(--force)" in told and "force=True" not in told


@pytest.mark.jit
def test_a_run_of_one_period_is_drawn(call):
    _, err, code = call("simulate", "--periods", "1", "--beta0", "16deg", "--plot", "one.png")
    assert (code, err) == (0, "")
    assert Path("one.png").exists()


@pytest.mark.jit
def test_a_dimer_that_stays_down_tells_its_speed(done):
    out = done("simulate", "--f", "25", "--beta0", "88 deg", "--periods", "60")
    assert re.search(r"both ends stay down, speed +│ 0\.\d+ +│ m/s", out)


def test_a_map_is_made_told_of_and_not_made_again(call, refused, fake_kernel, monkeypatch):
    Path("map.toml").write_text(SMALL_MAP)
    out, err, _ = call("run", "map.toml")
    assert re.search(r"(\d+)/\1 points, 100 %, elapsed", err)
    assert out.splitlines()[-2:] == ["cube: fig08-small.nc", "picture: fig08-small.png"]
    assert call("status", "fig08-small.nc")[0].startswith("fig08-small.nc: complete, 125 points")
    no_work(monkeypatch)
    for more in ([], ["--retry"]):
        _, err, code = call("run", "map.toml", *more)
        assert (code, err) == (0, "fig08-small.nc: is complete already; nothing was run\n")
    told = refused("run", "map.toml", "--rtol", "1e-5", lines=2)
    assert told.splitlines()[1:] == ["  rtol: 1e-06 -> 1e-05"]


def test_a_cube_is_made_again_from_what_it_tells(done, refused, fake_kernel, monkeypatch):
    done("run", "small.toml", "--no-plot")
    out = done("run", "--from", "fig07-small.nc", "--out", "again.nc")
    assert out.splitlines()[1].startswith("f = 15 Hz: initial dip angles that drift")  # it is drawn as it was declared
    first, again = dimersweep.open_cube("fig07-small.nc"), dimersweep.open_cube("again.nc")
    for name, variable in first.variables.items():
        assert variable.values.tobytes() == again[name].values.tobytes(), name
    for name in ("configuration", "configuration_sha256", "title", "plot"):
        assert first.attrs[name] == again.attrs[name]
    another_version(monkeypatch)
    told = refused("run", "--from", "fig07-small.nc", "--out", "third.nc", lines=2)
    assert told.startswith("fig07-small.nc: was made by another version, so its numbers may differ")
    assert told.splitlines()[1] == "  kernel_version: the sources of dimersweep are those of another version"
    done("run", "--from", "fig07-small.nc", "--out", "third.nc", "--other-kernel", "--no-plot")


def test_a_cube_that_has_no_picture_is_made_again(call, done, refused, fake_kernel):
    one = SMALL.partition("[plot]")[0].replace("f = [15, 20, 25]", "f = [15]").partition("beta0")[0]
    Path("one.toml").write_text(one)
    for arguments in (["run", "one.toml"], ["run", "--from", "fig07-small.nc", "--out", "again.nc"]):
        out, err, code = call(*arguments)
        assert (code, out.splitlines()[-1]) == (
            0,
            f"cube: {arguments[-1] if '--out' in arguments else 'fig07-small.nc'}",
        )
        assert err.splitlines()[-1].endswith(
            "was not drawn (mode_map: has axes none; needs one of more than one value)"
        )
    told = refused("explore", "again.nc", "--no-show")
    assert told == "again.nc: explore: needs a cube over at least one axis of more than one value"


def test_all_mistakes_of_a_file_are_told_at_once(refused):
    bad = SMALL.replace("periods =", "perods =").replace("mu = 0.2", "mu = -1\nGama = 2").replace('"segments"', '"pie"')
    bad = bad.replace("[grid]", "rtol = 3\n[grid]").replace("fig07-small.nc", "fig07.csv")
    Path("small.toml").write_text(bad.replace("f = [15, 20, 25]", 'f = ["15 m"]'))
    first, *lines = refused("run", "small.toml", lines=8).splitlines()
    assert first == "small.toml: 7 mistakes"
    assert [line.split(" (allowed")[0] for line in lines] == [
        "  rtol = 3.0: must be in [1e-13, 0.01]",
        "  sweep.output = fig07.csv: a cube must end in .nc or .zarr",
        "  sweep.perods: unknown key; did you mean periods?",
        "  plot.kind = 'pie': must be 'segments', 'mode_map', 'regions', 'paths', 'walks', 'trends', 'minimum', 'impact_ends', "
        "'shares', 'planar', 'bifurcation' or 'circles'",
        "  f = '15 m': the unit must be Hz, rpm or the like",
        "  mu = -1.0: must be >= 0",
        "  Gama: unknown parameter; did you mean Gamma?",
    ]


def test_a_title_may_be_left_out_and_a_fixed_angle_be_in_degrees(done, fake_kernel):
    bare = SMALL.replace('title = "Drift over the initial dip angle (Fig. 7, coarse)"\n', "").partition("[plot]")[0]
    Path("small.toml").write_text(bare + 'phi0 = { value = 90, unit = "deg" }\n')
    done("run", "small.toml", "--no-plot")
    cube = dimersweep.open_cube("fig07-small.nc")
    assert cube.attrs["title"] == "sweep of a 3D dimer on a vibrating plate"
    assert cube["phi0"].item() == pytest.approx(1.5707963)


def test_presets_are_listed_printed_and_run(call, done, refused, fake_kernel):
    out, _, _ = call("presets")
    names = {str(path.relative_to(ROOT / "sweeps").with_suffix("")) for path in (ROOT / "sweeps").rglob("*.toml")}
    assert {line.split()[0] for line in out.splitlines()} == names
    assert any(line.startswith("fig08 ") and "Regions of the e-Gamma plane" in line for line in out.splitlines())
    assert call("presets", "fig07-small")[0].strip() == SMALL.strip()
    done("run", "fig07-small", "--no-plot")
    assert Path("fig07-small.nc").exists()
    assert refused("run", "fig7").startswith("fig7: unknown preset, and no file; did you mean fig")


@pytest.mark.jit
def test_a_bifurcation_diagram_is_a_preset(call):
    out, err, code = call("run", "bifurcation-small")
    assert (code, "warning" in err) == (0, False)
    assert out.splitlines()[-1] == "picture: bifurcation-small.png"
    assert dimersweep.open_cube("bifurcation-small.nc").sizes == {"Gamma": 41, "strobe": 16}


def test_a_shell_completes_commands(monkeypatch):
    done = subprocess.run(
        ["dimersweep"],
        env=os.environ | {"_DIMERSWEEP_COMPLETE": "complete_bash", "COMP_WORDS": "dimersweep pre", "COMP_CWORD": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["presets"]


def test_fail_fast_names_the_point_and_keeps_the_rest(call, done, monkeypatch):
    use_kernel(monkeypatch, failing(lambda rows: rows[:, ROW.index("f")] == 20))
    _, err, code = call("run", "small.toml", "--fail-fast", "--workers", "1")
    assert code == 2
    assert err.splitlines()[-1].startswith("dimersweep: error: point 44 (f = 20.0, beta0 = 0.0349")
    assert ") failed: jammed: no contact force" in err
    assert "points are kept in fig07-small.nc.tiles; run the same again to go on" in err
    _, err, code = call("run", "small.toml")
    assert (code, "failed 44" in err) == (0, True)
    assert "failed 44" in call("status", "fig07-small.nc")[0]
    use_kernel(monkeypatch, fake_run_many)
    done("run", "small.toml", "--retry")
    assert "failed" not in call("status", "fig07-small.nc")[0]


def test_points_that_cannot_be_run_end_in_a_line_and_an_exit_code(call, done, monkeypatch):
    use_kernel(monkeypatch, raising(lambda rows: rows[:, ROW_BETA0] > 1.5))
    _, err, code = call("run", "small.toml")
    assert code == 2
    assert re.match(
        r"dimersweep: error: \d+ points could not be run, such as point .*: MemoryError: ", err.splitlines()[-1]
    )
    assert os.listdir() and not Path("fig07-small.nc").exists()
    use_kernel(monkeypatch, fake_run_many)
    done("run", "small.toml")


def test_an_axis_nested_deeply_is_refused(refused):
    for deep, told in (
        (5000, "small.toml: is nested too deeply"),
        (50, "small.toml: f = [[[[[[[...]]]]]]]: must be a number"),
    ):
        edited("f = [15, 20, 25]", "f = " + "[" * deep + "1.0" + "]" * deep)
        assert refused("run", "small.toml") == told


@pytest.mark.parametrize("out", ["", ".", "..", "/dev/full", "a" * 300])
def test_an_output_that_is_no_file_is_refused_before_any_work(refused, monkeypatch, out):
    no_work(monkeypatch)
    edited('output = "fig07-small.nc"', f'output = "{out}"')
    for arguments in (("run", "small.toml"), ("run", "small.toml", "--force")):
        assert refused(*arguments).startswith("small.toml: sweep.output = ")
    Path("small.toml").write_text(SMALL)
    assert refused("run", "small.toml", "--out", out).startswith("out = ")


@pytest.mark.jit
def test_a_straight_path_is_told(done):
    out = done("simulate", "--mu", "0", "--mu_s", "0")
    assert out.count("none: straight") == 3 and "nan" not in out


@pytest.mark.parametrize("command", [("simulate",), ("run", "small.toml")])
def test_a_number_of_periods_beyond_any_run_is_refused(refused, command):
    told = "periods = 9223372036854775808: must be <= 1000000000"
    assert refused(*command, "--periods", str(2**63)) == told


@pytest.mark.parametrize("path", sorted((ROOT / "sweeps").glob("*.toml")), ids=lambda path: path.stem)
def test_every_dataset_has_a_plan(call, fake_kernel, monkeypatch, path):
    monkeypatch.setattr("dimersweep.studies.planning.MOST_PARTS", 1)
    for slow in ("studies.observers.Paths", "analysis.observers.Sustained"):
        monkeypatch.setattr(f"dimersweep.{slow}.observe", lambda *given: None)
    out, err, code = call("plan", str(path))
    assert (code, err) == (0, "")
    assert [line.split(":")[0] for line in out.splitlines()] == ["points", "tiles", "cube", "time", "sample"]
    assert os.listdir() == ["small.toml"]


def test_a_plan_writes_nothing_and_takes_any_grid(call, done, fake_kernel, monkeypatch):
    out = done("plan", "small.toml", "--workers", "3")
    assert [line.split(":")[0] for line in out.splitlines()] == ["points", "tiles", "cube", "time", "sample"]
    assert out.startswith("points: 132\n") and "on 3 threads" in out and "132 random points" in out
    many = "beta0 = { start = 2, stop = 88, num = 2000000, unit = 'deg' }\nxdot0 = { start = 0, stop = 1, num = 500 }"
    edited("xdot0 = 1", "")
    Path("small.toml").write_text(re.sub("beta0 = .*", many, Path("small.toml").read_text()))
    run = []

    def counting(rows, *rest, until=0, space=None):
        run.append(len(rows))
        return fake_run_many(rows, *rest, until=until)

    use_kernel(monkeypatch, counting)
    out, err, code = call("plan", "small.toml")
    assert (code, err) == (0, "")
    assert out.startswith("points: 3000000000\n")
    _, err, code = call("run", "small.toml", "--no-plot")
    assert code == 2
    assert err.startswith("dimersweep: error: grid: 3000000000 points; one cube in memory may hold 50000000 (an output")
    assert 0 < sum(run) <= MOST_PARTS
    assert os.listdir() == ["small.toml"]
