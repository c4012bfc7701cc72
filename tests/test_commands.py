"""What is common to all commands: their help, what they print for programs, what a shell completes, and those for orbits."""

import json
import os
import re
import shlex
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

import dimersweep
from dimersweep import cli, fits, orbits, stability
from dimersweep.analysis.commands.measuring import named, table_of
from dimersweep.inputs import as_numbers
from dimersweep.studies.presets import presets
from dimersweep.symbols import HIGHER, INSTEAD, PARAMETERS, PICTURE_KINDS, QUANTITIES
from tests.seams import before_each_misfit, exit_plainly

ROOT = Path(__file__).parents[1]
COMMANDS = [one.callback.__name__ for one in cli.app.registered_commands]
TIMES = np.sort(np.random.default_rng(1).uniform(20, 60, 200))
SLIPPY = ["--mu", "0.3", "--mu_s", "0.6"]
FIT = ["fit", "track.csv", "e=0.58:0.75", "spin=100:160", "--sigma", "10mm", *SLIPPY]
DIMER = ["--e", "0.65", "--f", "22", "--A_r", "5", "--mu", "0.1", "--mu_s", "0.15"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder of files for commands."""
    folder = tmp_path_factory.mktemp("files")
    shutil.copyfile(ROOT / "sweeps" / "fig07-small.toml", folder / "small.toml")
    angles = 2 * np.pi * TIMES / 34.96
    places = [4.015 * np.cos(angles), 4.015 * np.sin(angles)]
    np.savetxt(
        folder / "track.csv", np.column_stack([TIMES, *places]), delimiter=",", header="t [s],x [m],y [m]", comments=""
    )
    t = np.arange(8000) / 2000
    plate = -9 * np.sin(94 * t) - 0.3 * np.sin(188 * t + 1)
    np.savetxt(folder / "plate.csv", np.column_stack([t, plate]), delimiter=",", header="t [s],z [m/s2]", comments="")
    return folder


@pytest.fixture(scope="module")
def fitted(files):
    """The fit of `FIT`, in Python."""
    track = fits.circle(*np.loadtxt(files / "track.csv", delimiter=",", skiprows=1).T, sigma=0.01)
    return fits.fit(track, {"e": (0.58, 0.75), "spin": (100, 160)}, mu=0.3, mu_s=0.6, progress=False)


@pytest.fixture(autouse=True)
def in_a_folder_of_files(empty_folder, coarse_pictures, files):
    shutil.copytree(files, ".", dirs_exist_ok=True)


# --- tables -----------------------------------------------------------------------------------------------------------
TABLES = [  # commands that print tables
    ["simulate", "--periods", "60"],
    ["simulate", "--periods", "300", "--tilt", "1deg"],
    ["simulate", "--periods", "300", "--Gamma", "1.6", "--e", "0.75", "--error"],
    ["orbits", *DIMER, "--Gamma", "0.9"],
    ["orbits", "--spin", "100", "--follow", "Gamma=1.3"],
    ["attractors", "beta0=1deg:89deg", *DIMER, "--starts", "8", "--periods", "200", "--slow"],
    ["later", "--spin", "100", "--seconds", "3h", *DIMER],
    ["lyapunov", "--Gamma", "3", "--before", "60", "--periods", "40", "--all"],
    ["power", "--before", "40", "--periods", "20"],
    ["waveform", "plate.csv"],
    FIT,
]
# units of what tables show, by its name
SHOWN_UNITS = {
    **dict.fromkeys(("radius", "path_radius"), "m"),
    **dict.fromkeys(("period", "event time error", "rtol decides a slip at", "slow_time"), "s"),
    **dict.fromkeys(("speed", "path_speed", "velocity of the centre", "both ends stay down, speed"), "m/s"),
    **dict.fromkeys(("zeta", "phase"), "rad"),
    **dict.fromkeys(("spin", "spin_low", "spin_high", "precession_rate"), "rad/s"),
    **dict.fromkeys(("state error", "impact_phase", "intensity", "its error"), "1"),
    "exponent": "1/s",
    "power": "W",
    "e": "",
}
ERRORS = {"lyapunov": "1/s", "waveform": "rad"}  # units of a column of errors


def units_shown_in(heads, rows):
    """The unit of each column of numbers, or, where units have a column of their own, of each row."""
    if "unit" in heads:
        where = heads.index("unit")
        return {row[0]: row[where].replace(" s-1", "/s") for row in rows if len(row) > where}
    return {name: unit.rstrip("]") for name, _, unit in (head.partition(" [") for head in heads) if unit}


@pytest.mark.parametrize("arguments", TABLES, ids=lambda words: " ".join(words[:3]))
def test_a_table_is_printed_whole_at_any_width(arguments, done, capsys, monkeypatch, request):
    from dimersweep.cli.printing import print_table

    if arguments == FIT:
        fit = request.getfixturevalue("fitted")
        monkeypatch.setattr("dimersweep.analysis.fits.fitting.fit", lambda *_, **__: fit)
    printed = []
    for module in ("printing", "simulating"):
        monkeypatch.setattr(f"dimersweep.cli.{module}.print_table", lambda *table: printed.append(table))
    done(*arguments)
    assert printed
    for heads, rows in ([[*heads], [[*row] for row in rows]] for heads, rows in printed):
        shown = units_shown_in(heads, rows)
        known = SHOWN_UNITS | {"error": ERRORS.get(arguments[0])}
        assert shown == {name: known[name] for name in shown}
        for width, terminal in ((40, True), (80, True), (40, False), (300, True)):
            monkeypatch.setenv("COLUMNS", str(width))
            monkeypatch.setattr(sys.stdout, "isatty", lambda terminal=terminal: terminal, raising=False)
            print_table(heads, rows)
            lines = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out).splitlines()  # without colours
            assert not terminal or max(map(len, lines), default=0) <= width
            if lines and lines[0].startswith("┏"):
                head, *body = (
                    [cell.strip() for cell in re.split("[│┃]", line)[1:-1]] for line in lines if line[0] in "│┃"
                )
                assert (head, body) == (heads, [row + [""] * (len(heads) - len(row)) for row in rows])
            else:
                assert terminal
                wanted = [f"{head}: {cell}" for row in rows for head, cell in zip(heads, row, strict=False) if cell]
                assert " ".join(" ".join(lines).split()) == " ".join(" ".join(wanted).split())


def test_a_pipe_has_no_width(done):
    arguments = ["attractors", "beta0=1deg:89deg", "--starts", "8", "--periods", "100"]
    words = done(*arguments).split()
    told = json.loads(done(*arguments, "--json"))["attractors"]
    numbers = [value for row in told for value in row.values() if isinstance(value, float)]
    assert len(numbers) > 4 and {f"{value:.6g}" for value in numbers} <= {*words}
    assert {*told[0]} <= {*words}


def test_commands_print_no_other_tables():
    assert [path.name for path in Path(cli.__file__).parent.glob("*.py") if "rich.table" in path.read_text()] == [
        "printing.py"
    ]


# --- help -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_no_flag_is_shown_with_a_type(command):
    shown = CliRunner(env={"COLUMNS": "200"}).invoke(cli.app, [*command.split(), "--help"]).output
    assert "--help" in shown
    assert "<bool>" not in shown
    assert command in ("", "explore") or ("--json" in shown and "--quiet" in shown)


def test_parameters_stand_in_groups():
    params = {each.name: each for each in get_command(cli.app).commands["simulate"].params}
    groups = {name: params[name].rich_help_panel for name in (*PARAMETERS, *INSTEAD, "harmonics")}
    expected = {
        "e": "Dimer",
        "r": "Dimer",
        "l": "Dimer",
        "Gamma": "Plate",
        "Gamma_2": "Plate",
        "phi_y": "Plate",
        "A_z": "Plate",
    }
    expected |= {"harmonics": "Plate", "beta0": "Start", "phi0": "Start", "gap0": "Start", "tilt": "Imperfections"}
    expected |= {"r_1": "Imperfections", "mu_h": "Imperfections", "eta": "Imperfections"}
    assert {name: groups[name] for name in expected} == expected
    assert {groups[name] for name in HIGHER} == {"Plate"}
    assert {params[name].rich_help_panel for name in ("periods", "rtol", "max_seconds")} == {"Run"}
    assert {params[name].rich_help_panel for name in ("plot", "save", "force", "json")} == {"Output"}


def test_each_example_of_the_help_is_a_call_that_is_understood():
    group = get_command(cli.app)
    for command, (_, *examples) in cli.EXAMPLES.items():
        for example in examples:
            name, *arguments = shlex.split(example.partition(">")[0])
            assert name == command.__name__
            with group.commands[name].make_context(name, arguments) as context:
                assert example.partition(">")[0].split()[1:] == [] or any(context.params.values())


# --- completion -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("run fig", [name for name in presets() if name.startswith("fig")]),
        ("plan atl", []),
        ("borders atl", [name for name in presets("borders") if name.startswith("atl")]),
        ("plot x.nc --kind mode", [kind for kind in PICTURE_KINDS if kind.startswith("mode")]),
        ("plot x.nc --quantity rad", [name for name in QUANTITIES if name.startswith("rad")]),
        ("fit track.csv mu", [f"{name}=" for name in PARAMETERS if name.startswith("mu")]),
        ("plot x.nc --select bet", [f"{name}=" for name in PARAMETERS if name.startswith("bet")]),
    ],
)
def test_a_shell_completes_words(monkeypatch, capsys, typed, words):
    line = f"dimersweep {typed}"
    monkeypatch.setenv("_DIMERSWEEP_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split()) - 1))
    with pytest.raises(SystemExit):
        cli.app(prog_name="dimersweep")
    assert capsys.readouterr().out.split() == words


# --- for programs -----------------------------------------------------------------------------------------------------
def test_a_sweep_tells_a_program_what_it_has_made(done, call, fake_kernel):
    out, err, code = call("run", "small.toml", "--json")
    told = json.loads(out)
    cube = dimersweep.open_cube("fig07-small.nc")
    assert (code, told["cube"], told["picture"]) == (0, "fig07-small.nc", "fig07-small.png")
    assert sum(told["modes"].values()) == cube["mode"].size
    lengths = dimersweep.drift_lengths(cube)
    assert [(row["f"], row["length"]) for row in told["drift_lengths"]] == list(
        zip(lengths["f"].values.tolist(), lengths.values.tolist(), strict=True)
    )
    assert "132/132 points" in err
    status = json.loads(done("status", "fig07-small.nc", "--json"))
    assert (status["written"], status["share"], status["modes"]) == (True, 1.0, told["modes"])
    plan = json.loads(done("plan", "small.toml", "--json"))
    assert (plan["points"], plan["done"]) == (132, 0)
    assert plan["seconds"] > 0
    titles = json.loads(done("presets", "--json"))
    assert titles["fig07-small"] == cube.attrs["title"]


def test_quiet_prints_nothing(call, fake_kernel):
    assert call("run", "small.toml", "--quiet") == ("", "", 0)
    assert {"fig07-small.nc", "fig07-small.png"} < {*os.listdir()}
    assert call("plot", "fig07-small.nc", "--quantity", "radius", "--quiet") == ("", "", 0)
    assert call("simulate", "--periods", "5", "--quiet") == ("", "", 0)
    _, err, code = call("simulate", "--e", "2", "--quiet")
    assert code == 2
    assert err.startswith("dimersweep: error: e = 2")


# --- pictures ---------------------------------------------------------------------------------------------------------
def test_a_picture_has_the_name_of_what_it_shows(done, call, fake_kernel):
    done("run", "small.toml", "--no-plot")
    for option, word in (("--quantity", "radius"), ("--kind", "mode_map")):
        assert done("plot", "fig07-small.nc", option, word).splitlines()[-1] == f"picture: fig07-small-{word}.png"
        assert Path(f"fig07-small-{word}.png").exists()
    for option, word, meant in (("--quantity", "radios", "radius"), ("--kind", "mode-map", "mode_map")):
        _, err, code = call("plot", "fig07-small.nc", option, word, "--out", "fig07-small-radius.png")
        assert code == 2
        assert f"{option[2:]}: {word}: unknown" in err
        assert f"did you mean {meant}?" in err


def test_a_run_says_which_files_it_wrote(done):
    files = ["--save", "run.nc", "--plot", "run.png", "--movie", "run.gif"]
    assert done("simulate", "--periods", "1", *files).splitlines()[-3:] == [
        "run: run.nc",
        "picture: run.png",
        "movie: run.gif",
    ]
    assert {"run.nc", "run.png", "run.gif"} <= set(os.listdir())


# --- orbits and attractors --------------------------------------------------------------------------------------------
def test_the_circles_of_a_dimer(done, monkeypatch):
    found = orbits.sustained(spin=(0, 90), e=0.65, f=22, A_r=5, mu=0.1, mu_s=0.15)
    assert found.sizes["sustained"] == 2
    asked = []
    monkeypatch.setattr("dimersweep.analysis.orbits.sustained", lambda **parameters: asked.append(parameters) or found)
    told = json.loads(done("orbits", *DIMER, "--json"))["circles"]
    assert asked == [{"e": "0.65", "f": "22", "A_r": "5", "mu": "0.1", "mu_s": "0.15"}]
    assert [row["spin"] for row in told] == found["spin"].values.tolist()
    assert [row["attracts"] for row in told] == found["attracts"].values.tolist()
    assert told[0]["radius"] is None or told[0]["radius"] > 0


def test_an_orbit_and_its_branch(done, call):
    told = json.loads(
        done("orbits", "--spin", "100", "--follow", "Gamma=1.3", "--json", "--out", "b.nc", "--plot", "b.png")
    )
    orbit = orbits.find(spin=100.0)
    assert told["orbits"][0]["radius"] == orbit.radius
    branch = orbits.follow(orbit, "Gamma", to=1.3)
    special = branch["Gamma"].values[dimersweep.names(branch["special"]).values != "none"]
    assert [row["Gamma"] for row in told["special_points"]] == pytest.approx(special.tolist())
    assert told["end"] == branch.attrs["end"]
    assert Path("b.png").read_bytes().startswith(b"\x89PNG")
    assert done("plot", "b.nc", "--out", "again.png").splitlines() == ["picture: again.png"]
    _, err, code = call("orbits", "--follow", "Gamma=1.3")
    assert (code, err) == (2, "dimersweep: error: --follow and --plot need --spin, that of the orbit\n")


def test_attractors_from_drawn_starts(done, call):
    few = ["beta0=1deg:89deg", "--starts", "40", "--periods", "200"]
    told = json.loads(done("attractors", *few, "--json", "--out", "a.nc", "--plot", "a.png"))["attractors"]
    found = dimersweep.attractors({"beta0": ("1 deg", "89 deg")}, starts=40, periods=200, progress=False)
    assert [row["mode"] for row in told] == ["rest", "drift"]
    assert [row["share"] for row in told] == found["share"].values.tolist()
    assert told[0]["radius"] is None
    assert done("plot", "a.nc", "--out", "again.png").splitlines() == ["picture: again.png"]
    assert {"a.nc", "a.png", "again.png"} <= set(os.listdir())
    _, err, code = call("attractors", "beta0")
    assert code == 2
    assert "'beta0': must be NAME=LOW:HIGH, such as beta0=1deg:89deg, or phi0=any" in err


# --- after a time, growth, power ----------------------------------------------------------------------------------------
def test_where_a_motion_is_after_some_hours(done, call):
    rows = json.loads(done("later", "--spin", "110", "--seconds", "3h", "--json"))["later"]
    then = orbits.later(orbits.find(spin=110.0), periods=3 * 3600 * 15)
    assert [row["when"] for row in rows] == ["at first", "after 3h"]
    assert [rows[1][name] for name in ("spin", "radius", "period", "zeta")] == [*then[:4]]
    rows = json.loads(done("later", "--beta0", "20deg", "--periods", "1000", "--json"))["later"]
    run = dimersweep.simulate(beta0="20 deg", periods=2000, stop_when_settled=True)
    assert rows[0]["spin"] == orbits.find(run).spin and rows[1]["when"] == "after 1000 periods"
    told = "dimersweep: error: the start leads to rest, which is on no orbit; give another one, or --spin\n"
    assert call("later", "--beta0", "5deg", "--seconds", "inf") == ("", told, 2)
    _, err, code = call("later", "--spin", "110")
    assert (code, err) == (2, "dimersweep: error: give either --seconds, such as 3h, or --periods\n")


def test_exponents_of_a_motion(done):
    how = ["lyapunov", "--Gamma", "3", "--before", "100", "--periods", "60", "--json"]
    run = dimersweep.simulate(Gamma=3.0, periods=100)
    (row,), all_of_them = (json.loads(done(*how, *more))["lyapunov"] for more in ([], ["--all"]))
    found, spectrum = stability.lyapunov(run, 60), stability.spectrum(run, 60)
    assert row == {**found._asdict()}
    finite = np.isfinite(spectrum.exponents)
    assert [row["exponent"] for row in all_of_them] == [*np.where(finite, spectrum.exponents, None)]


def test_power_is_that_of_the_energy_budget(done):
    told = json.loads(done("power", "--f", "16", "--before", "100", "--periods", "50", "--out", "b.nc", "--json"))
    budget = dimersweep.simulate(f=16, periods=150).energy()
    for row in told["power"]:
        mean = float(budget[row["term"]][-50:].mean()) * 16
        assert row["power"] == pytest.approx(mean, rel=1e-12, abs=1e-18)
    assert sum(row["power"] for row in told["power"]) == pytest.approx(0, abs=1e-6)  # the walk has settled
    assert told["table"] == "b.nc" and Path("b.nc").stat().st_size


# --- tracks -----------------------------------------------------------------------------------------------------------
def test_a_track_is_fitted_as_in_python(done, fitted):
    told = json.loads(done(*FIT, "--json", "--out", "fit.txt", "--plot", "fit.png"))
    rows = {row["parameter"]: row for row in told["fitted"]}
    for name, value in fitted.values.items():
        assert (rows[name]["value"], rows[name]["error"]) == pytest.approx((value, fitted.errors[name]), rel=1e-6)
    assert told["track"]["path_radius"] == pytest.approx(4.015, abs=1e-6) and told["possible"]
    assert Path("fit.txt").read_text().splitlines()[0].split() == ["free", "value", "error", "range"]
    assert Path("fit.png").read_bytes().startswith(b"\x89PNG")


HEADS = {  # of tracks, as programs write them, and what a row of them is
    "no head": "{t} {x} {y}\n",
    "a line of units": "Frame;Zeit;X;Y\n;[ms];[mm];[mm]\n{k};{ms};{x_mm};{y_mm}\n",
    "a unit after a slash": "t/s\tx/mm\ty/mm\n{t}\t{x_mm}\t{y_mm}\n",
    "a name of a body": "mass A,,\nt,x,y\n{t},{x},{y}\n",
    "further columns": "frame,time_ms,pos_x (mm),pos_y (mm),area\n{k},{ms},{x_mm},{y_mm},7\n",
    "lost frames": "t,x,y\n0.5,,\n{t},{x},{y}\n",
}


@pytest.mark.parametrize("kind", HEADS)
def test_tracks_are_read_as_programs_write_them(kind):
    *head, row = HEADS[kind].splitlines(keepends=True)
    rows = [
        row.format(k=k, t=t, x=x, y=y, ms=1e3 * t, x_mm=1e3 * x, y_mm=1e3 * y)
        for k, (t, x, y) in enumerate(np.loadtxt("track.csv", delimiter=",", skiprows=1))
    ]
    if kind == "lost frames":
        rows[3:3] = [head.pop()]
    Path("other.csv").write_text("".join([*head, *rows]))
    seen = table_of(Path("other.csv"))
    columns = named(Path("other.csv"), seen, {"t": None, "x": None, "y": None}, "xy")
    found = [
        as_numbers(name, seen.dropna("sample")[columns[name]], units) for name, units in zip("txy", "smm", strict=True)
    ]
    np.testing.assert_allclose(found, np.loadtxt("track.csv", delimiter=",", skiprows=1).T, rtol=1e-12)


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ("frame,x,y\n1,2,3\n2,3,4\n", "has no column t; give --t (there are frame, x, y)"),
        ("t,x,y,x,y\n1,2,3,1,2\n2,3,4,2,3\n", "has 2 columns x, x, x.4; give --x"),
        ("t,u,v,w\n1,2,3,1\n2,3,4,2\n", "has no column x; give --x (there are t, u, v, w)"),
        ("hello\n", "has no columns of numbers"),
    ],
)
def test_a_track_whose_columns_are_not_clear_is_refused(call, table, told):
    Path("other.csv").write_text(table)
    assert call("fit", "other.csv", "e=0.5:0.7") == ("", f"dimersweep: error: other.csv: {told}\n", 2)


def test_a_fit_that_is_stopped_ends_with_the_best_values(call, monkeypatch):
    seen = []

    def interrupted(orbit):
        seen.append(orbit)
        if len(seen) == 10:
            signal.raise_signal(signal.SIGINT)

    exit_plainly(monkeypatch)
    before_each_misfit(monkeypatch, interrupted)
    _, err, code = call(*FIT, "--plot", "fit.png")
    values = r"e = \S+, spin = \S+ \(chi-square \S+\), without errors"
    told = f"dimersweep: interrupted: the best values of the fit so far are {values}"
    assert code == 130 and re.fullmatch(told, err.splitlines()[-1]) and not Path("fit.png").exists()


def test_attractors_from_any_phase_of_a_plate_with_harmonics(done):
    Path("plate.toml").write_text("f = 15.0\n[z]\n1 = [0.9, 0.0]\n2 = [0.05, 1.0]\n")
    few = ["--starts", "20", "--periods", "200", "--json"]
    told = json.loads(done("attractors", "phi0=any", "--harmonics", "plate.toml", *few))["attractors"]
    starts, plate = {"phi0": ("0 deg", "360 deg")}, {"harmonics": "plate.toml"}
    found = dimersweep.attractors(starts, plate, starts=20, periods=200, progress=False)
    assert [row["share"] for row in told] == found["share"].values.tolist()
