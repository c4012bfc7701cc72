"""What is common to all commands: their help, what they print for programs, what a shell completes, and those for orbits."""

import json
import os
import re
import shlex
import sys
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import dimersweep
from dimersweep import cli, orbits
from dimersweep.studies.presets import presets
from dimersweep.symbols import HIGHER, INSTEAD, PARAMETERS, PICTURE_KINDS, QUANTITIES

ROOT = Path(__file__).parents[1]
COMMANDS = [one.callback.__name__ for one in cli.app.registered_commands]
DIMER = ["--e", "0.65", "--f", "22", "--A_r", "5", "--mu", "0.1", "--mu_s", "0.15"]


@pytest.fixture(autouse=True)
def in_an_empty_folder(empty_folder):
    Path("small.toml").write_text((ROOT / "sweeps" / "fig07-small.toml").read_text())


# --- tables -----------------------------------------------------------------------------------------------------------
TABLES = [  # commands that print tables
    ["simulate", "--periods", "60"],
    ["simulate", "--periods", "300", "--tilt", "1deg"],
    ["simulate", "--periods", "300", "--Gamma", "1.6", "--e", "0.75", "--error"],
    ["orbits", *DIMER, "--Gamma", "0.9"],
    ["orbits", "--spin", "100", "--follow", "Gamma=1.3"],
    ["attractors", "beta0=1deg:89deg", *DIMER, "--starts", "8", "--periods", "200", "--slow"],
]


@pytest.mark.parametrize("arguments", TABLES, ids=lambda words: " ".join(words[:3]))
def test_a_table_is_printed_whole_at_any_width(arguments, done, capsys, monkeypatch):
    from dimersweep.cli.printing import print_table

    printed = []
    for module in ("printing", "simulating"):
        monkeypatch.setattr(f"dimersweep.cli.{module}.print_table", lambda *table: printed.append(table))
    done(*arguments)
    assert printed
    for heads, rows in ([[*heads], [[*row] for row in rows]] for heads, rows in printed):
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
    for command, examples in cli.EXAMPLES.items():
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
    assert sorted(os.listdir()) == ["fig07-small.nc", "fig07-small.png", "small.toml"]
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
    assert done("simulate", "--periods", "5", *files).splitlines()[-3:] == [
        "run: run.nc",
        "picture: run.png",
        "movie: run.gif",
    ]
    assert {"run.nc", "run.png", "run.gif"} <= set(os.listdir())


# --- orbits and attractors --------------------------------------------------------------------------------------------
def test_the_circles_of_a_dimer(done):
    told = json.loads(done("orbits", *DIMER, "--json"))["circles"]
    found = orbits.sustained(e=0.65, f=22, A_r=5, mu=0.1, mu_s=0.15)
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
    assert "'beta0': must be NAME=LOW:HIGH, such as beta0=1deg:89deg" in err
