"""README, the page on sweeps and the tutorial run as they stand, and what README shows is what is printed."""

import re
import shlex
import shutil
from pathlib import Path

import jupytext
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"


def blocks(page, language):
    """The code blocks of a page, in order."""
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def commands(page):
    """The arguments of the lines of a page that call the program."""
    lines = [line for block in blocks(page, "bash") for line in block.splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("dimersweep ")]


def test_the_examples_run(empty_folder, capsys):
    python = blocks(README, "python")
    assert len(python) >= 2
    for block in python:
        exec(compile(block, str(README), "exec"), {})
    assert capsys.readouterr().out.startswith("drift ")
    assert (empty_folder / "cube.nc").exists()
    assert (empty_folder / "intervals.png").stat().st_size > 10_000


def table(text):
    """Value and unit of each row of a printed table; the changes per period, which are all but noise, are left out."""
    rows = [[cell.strip() for cell in line.split("│")[1:4]] for line in text.splitlines() if "│" in line]
    return {name: (value, unit) for name, value, unit in rows}


def test_the_run_prints_what_is_shown(call):
    (arguments,) = commands(README)
    (shown,) = map(table, blocks(README, "text"))
    printed = table(call(*arguments)[0])
    assert shown.keys() == printed.keys()
    for name, (value, unit) in shown.items():
        assert printed[name][1] == unit
        assert printed[name][0] == value or float(printed[name][0]) == pytest.approx(float(value), rel=1e-5)


def test_the_commands_on_sweeps_run_one_after_the_other(empty_folder, fake_kernel, call):
    shutil.copytree(ROOT / "sweeps", "sweeps")
    file, angles = Path("sweeps", "fig07.toml"), "start = 0.02, stop = 89.98, step = 0.02"
    written = file.read_text()
    assert angles in written
    file.write_text(written.replace(angles, "start = 0.2, stop = 89.8, step = 0.2"))  # a tenth of the points
    lines = commands(ROOT / "docs" / "sweeps.md")
    assert len(lines) >= 6
    told = [call(*line) for line in lines]
    assert all(code == 0 for *_, code in told)
    assert any("fig07.nc: complete, 1347 points" in out for out, *_ in told)
    assert {path.name for path in empty_folder.iterdir()} >= {"fig07.nc", "same.nc", "finer.nc", "again.png"}


@pytest.mark.slow
@pytest.mark.release
def test_the_tutorial_runs_again_in_a_folder_that_has_all_of_its_files(tmp_path):
    """The site runs all of it once: here are the cells that name files, after the ones that set up and import."""
    tutorial = jupytext.read(ROOT / "docs" / "tutorial.md")
    cells = [cell for cell in tutorial.cells if cell.cell_type == "code"]
    files = [cell for cell in cells if re.search(r"\w\.(nc|png|toml)\b", cell.source)]
    assert len(cells) > 20 and len(files) == 5
    tutorial.cells = [cells[0], cells[2], *files, *files]
    NotebookClient(tutorial, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()


SCRIPT = ROOT / "docs" / "all_of_it.py"
FEWER = {
    ".random(500)": ".random(60)",
    '"walk.gif",': '"walk.gif", periods=1,',
    "1.6, 141)}, periods=400": "1.6, 15)}, periods=100",
}


# the second time in a folder that has all of its files
@pytest.mark.parametrize("times", [1, pytest.param(2, marks=pytest.mark.release)])
def test_the_script_of_25_lines_runs(times, empty_folder):
    script = SCRIPT.read_text(encoding="utf-8")
    assert len(script.splitlines()) <= 25
    if times == 1:  # with fewer points and frames
        for whole, part in FEWER.items():
            assert script.count(whole) == 1
            script = script.replace(whole, part)
    for _ in range(times):
        exec(compile(script, str(SCRIPT), "exec"), {})
    for name in ("walk.nc", "sample.nc", "walk.gif", "bifurcation.png"):
        assert (empty_folder / name).stat().st_size > 1000
