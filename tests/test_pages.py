"""The pages for a new user: what they show is what comes out, and they can be read."""

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dimersweep import simulate
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
