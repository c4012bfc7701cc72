"""The pages for a new user: what they show is what comes out, and they can be read."""

import ast
import re
import sys
from pathlib import Path

import docutils.nodes
import docutils.utils
import nbformat
import pytest
from typer.testing import CliRunner

from dimersweep import plots, simulate
from dimersweep.cli import app
from dimersweep.symbols import DI_END_MEANINGS, MODE_MEANINGS, TRACK_MEANINGS

DOCS = Path(__file__).parents[1] / "docs"
WITHOUT_MOVIE = ("not_run", "failed")


def text_of(name):
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


# --- the motions ------------------------------------------------------------------------------------------------------
@pytest.fixture
def motions(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    yield __import__("make_figures").motions()
    sys.modules.pop("make_figures")


def test_the_page_of_the_motions_has_every_mode_with_its_sentence():
    page = text_of("motions")
    for mode, meaning in MODE_MEANINGS.items():
        assert f"\n## {mode}\n" in page or mode == "not_run"
        assert meaning in page or f"{meaning[0].upper()}{meaning[1:]}." in page


def test_each_command_of_that_page_makes_the_motion_of_its_movie(motions):
    assert set(motions) == set(MODE_MEANINGS) - set(WITHOUT_MOVIE)
    for mode, (periods, parameters) in motions.items():
        assert simulate(**parameters, periods=periods, record=False).mode == mode
        assert (DOCS / "figures" / "motions" / f"{mode}.gif").stat().st_size < 200_000


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], {"drift": MODE_MEANINGS, "arc": TRACK_MEANINGS, "sp_sk": DI_END_MEANINGS}),
        (["--beta0", "8deg"], {"rest": MODE_MEANINGS}),
        (["--periods", "100000", "--max-seconds", "0.01"], {"failed": MODE_MEANINGS}),
    ],
)
def test_a_command_says_what_the_words_of_its_verdict_mean(options, words):
    said = CliRunner().invoke(app, ["simulate", *options]).output
    for word, meanings in words.items():
        assert f"\n{word}: {meanings[word]}".replace("`", "") in said
    assert said.count("(docs/motions.md)") == 1


def test_a_run_says_what_the_words_of_its_verdict_mean_where_it_is_shown():
    run = simulate(periods=100)
    for shown in (str(run), run._repr_html_(), run.view(periods=1).html):
        for meaning in (f"{MODE_MEANINGS['drift']} (docs/motions.md)", TRACK_MEANINGS["arc"], DI_END_MEANINGS["sp_sk"]):
            assert meaning in shown


# --- how they are written ---------------------------------------------------------------------------------------------
GROUPS = re.findall(r":caption: \"?([^\"\n]+)\"?\n\n(.*?)```", text_of("index"), re.DOTALL)
GROUPS_OF = {caption: [name for name in names.split() if "/" not in name] for caption, names in GROUPS}
FIRST_DOOR = [
    "index",
    *(name for caption, names in GROUPS_OF.items() if caption.startswith("Use it") for name in names),
]
LOOKED_UP = GROUPS_OF["Use it: look it up"]  # tables and lists
NOTEBOOKS = sorted((DOCS.parent / "notebooks").glob("*.ipynb"))
PAGES = [*sorted(DOCS.glob("*.md")), *DOCS.parent.glob("*.md")]
MOST_WORDS = 38
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(---\n.*?^---\n)?(.*?)^```", re.DOTALL | re.MULTILINE)
DRAWING = {*plots.__all__, "draw_borders", "plot", "legend", "show", "Image"}  # calls that end a cell with a picture
ALT = re.compile(r"^    alt: \"[^\"]{20,}\"$", re.MULTILINE)
SEEN = re.compile(r"^!\[.+\]\(|^```\{code-cell\}(?![^\n]*\n:tags: \[remove-cell\])|^```text", re.MULTILINE)


def sentences(text):
    """The sentences of a page: those of its paragraphs, headings, items and cells of tables; a formula counts as a word."""
    text = re.sub(r"\A---\n.*?\n---\n|^(```+)[^\n]*\n.*?^\1", "\n\n", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"\$\$.*?\$\$|`[^`]*`|\$[^$]*\$", "x", text, flags=re.DOTALL)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    for block in re.split(r"\n\s*\n|\n\s*(?=[-*#] )|\n(?=\d+\. )|(?<!\\)\|", text):
        yield from re.split(r"(?<=[.?!])[)*\"]*\s+", " ".join(block.split()))


def draws(source):
    """Whether a cell ends with a picture: a figure, or a call that draws."""
    if source.startswith("%%"):
        return False
    last = ast.parse(re.sub(r"^[%:].*$", "", source, flags=re.MULTILINE)).body[-1:]
    shown = last[0].value if last and isinstance(last[0], ast.Expr) else None
    if isinstance(shown, ast.Call):
        return (shown.func.attr if isinstance(shown.func, ast.Attribute) else shown.func.id) in DRAWING
    return isinstance(shown, ast.Name) and shown.id == "figure"


def test_the_site_has_two_doors():
    assert sorted({name for names in GROUPS_OF.values() for name in names}) == sorted(
        page.stem for page in DOCS.glob("*.md") if page.stem != "index"
    )
    assert {"motions", "why", "questions"} <= set(FIRST_DOOR)
    referees = {"faults", "shortcuts", "stress", "benchmarks", "limits", "stopping", "claims", "scale"}
    assert referees <= set(GROUPS_OF["Evidence for referees"])


def too_long(text):
    return [sentence for sentence in sentences(text) if len(sentence.split()) > MOST_WORDS]


@pytest.mark.parametrize("name", FIRST_DOOR)
def test_no_sentence_for_a_new_user_is_long(name):
    assert too_long(text_of(name)) == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_no_sentence_of_a_notebook_is_long(path):
    cells = nbformat.read(path, as_version=4).cells
    assert too_long("\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")) == []


@pytest.mark.parametrize("name", [name for name in FIRST_DOOR if name not in LOOKED_UP])
def test_a_page_for_a_new_user_shows_something(name):
    assert SEEN.search(text_of(name))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_picture_has_a_text_and_every_letter_is_one(page):
    text = page.read_text(encoding="utf-8")
    assert "\N{REPLACEMENT CHARACTER}" not in text
    assert re.findall(r"!\[\s*\]\(", text) == []
    assert [source for head, source in CELL.findall(text) if draws(source) and not ALT.search(head)] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_picture_of_a_notebook_has_a_text(path):
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    drawn = [cell for cell in cells if any("image/png" in output.get("data", {}) for output in cell.outputs)]
    texts = [cell.metadata.get("mystnb", {}).get("image", {}).get("alt", "") for cell in drawn]
    assert len(drawn) >= 2 and min(map(len, texts)) >= 20


@pytest.fixture
def conf(monkeypatch):
    """How the site is built."""
    monkeypatch.syspath_prepend(str(DOCS))
    yield __import__("conf")
    sys.modules.pop("conf")


def test_the_site_warns_of_a_picture_without_a_text(conf, caplog):
    document = docutils.utils.new_document("page")
    document += [docutils.nodes.image(uri="a.png", alt="a circle"), docutils.nodes.image(uri="b.png")]
    conf.check_alts(None, document, "page")
    assert [record.message for record in caplog.records] == ["a picture has no alt text"]


def test_what_a_command_prints_in_pieces_is_one_text(conf, tmp_path):
    cell = nbformat.v4.new_code_cell("%%bash\nprintf 'one '; sleep 0.2; printf 'line'")
    notebook = nbformat.v4.new_notebook(cells=[cell])
    conf.executing.single_nb_execution(notebook, cwd=str(tmp_path), timeout=60, allow_errors=False)
    assert [output.text.rstrip() for output in notebook.cells[0].outputs] == ["one line"]


@pytest.mark.parametrize(
    ("source", "drawn"),
    [
        ("%matplotlib inline\nplots.segments(cube)\n", True),
        ("figure = Figure()\nfigure\n", True),
        ("axes.legend();\n", True),
        ("fit(measured, free).plot()\n", True),
        ("cube = sweep(grid)\ncube\n", False),
        ("figure = plots.segments(cube)\n", False),
        ("%%bash\ndimersweep plot\n", False),
    ],
)
def test_cells_that_draw_are_told_from_others(source, drawn):
    assert draws(source) == drawn


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("One `two` three.\nFour. Five", [3, 1, 1]),
        ("| a b | c d e |\n|---|---|\n", [2, 3]),
        ("- a b\n- c\n\n```python\nx = 1 + 2\n```\n", [3, 2]),
        ("A [link of words](page.md), $x + y$ and\n$$z = 1$$\nall.", [8]),
    ],
)
def test_sentences_are_told_apart(text, found):
    counts = [len(sentence.split()) for sentence in sentences(text)]
    assert [count for count in counts if count > 0][: len(found)] == found
