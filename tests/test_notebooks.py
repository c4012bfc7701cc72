"""The notebooks run, and what is stored in them is what they give."""

import re
import sys
from pathlib import Path

import nbformat
import pytest
from sybil.evaluators.doctest import NUMBER, OutputChecker

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def maker():
    """The program that fills the notebooks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "docs"))
        import make_notebooks

        yield make_notebooks
        del sys.modules["make_notebooks"]


def shown(notebook):
    """Lines, text and number of pictures of each code cell, in order."""
    for cell in notebook.cells:
        if cell.cell_type == "code":
            outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
            texts = [output.text if "text" in output else output.data["text/plain"] for output in outputs]
            text = re.sub(
                r"(\bkernel +int64 8B) \d+", r"\1", "\n".join(texts)
            )  # its version is another one after each edit
            yield cell.source, text, sum("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.parametrize("path", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_every_figure_of_a_notebook_is_a_picture(path):
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    data = [output["data"] for cell in cells for output in cell.outputs if "data" in output]
    figures = [each for each in data if " size " in each.get("text/plain", "")]
    assert figures and all("image/png" in each for each in figures)


@pytest.mark.parametrize("path", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_asks_a_question_says_how_to_open_it_and_ends_with_exercises(path):
    first, *_, last = nbformat.read(path, as_version=4).cells
    title, *_ = first.source.splitlines()
    assert title.startswith("# ") and title.endswith("?")
    assert "pip install '.[notebooks]'" in first.source and f"notebooks/{path.name}" in first.source
    assert last.source.startswith("## Exercises\n") and re.findall(r"^(\d)\. ", last.source, re.MULTILINE) == ["1", "2"]


ALL = {"figures": 8, "which_walk": 7, "imperfect": 4, "orbits": 2, "observers": 2, "slow_time": 3}
QUICK = "observers"
FEWER = {"np.linspace(0.9, 1.9, 41)": "np.linspace(0.9, 1.9, 5)"}  # points of a curve that is looked at as a picture


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "least"),
    [pytest.param(*each, marks=[] if each[0] == QUICK else pytest.mark.release) for each in ALL.items()],
)
def test_a_notebook_gives_what_is_stored_in_it(name, least, maker, tmp_path):
    path = ROOT / "notebooks" / f"{name}.ipynb"
    assert path in maker.NOTEBOOKS
    stored, run = list(shown(nbformat.read(path, as_version=4))), path
    if name == QUICK:
        run, written = tmp_path / path.name, path.read_text(encoding="utf-8")
        for whole, part in FEWER.items():
            assert written.count(whole) == 1
            written = written.replace(whole, part)
        run.write_text(written, encoding="utf-8")
    fresh = list(shown(maker.executed(run)))
    assert sum(pictures for *_, pictures in stored) >= least
    for (source, text, pictures), (_, new_text, new_pictures) in zip(stored, fresh, strict=True):
        assert pictures == new_pictures, source
        # numbers are compared to the digits that are shown
        assert OutputChecker().check_output(text, new_text, NUMBER), f"{source}\nstored:\n{text}\nnow:\n{new_text}"
