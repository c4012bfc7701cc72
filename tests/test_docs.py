"""What the pages in docs/ name is there: files of the kernel, links, pictures."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").glob("*.md"), *ROOT.glob("*.md")])


def test_every_file_that_the_page_of_the_model_names_is_there():
    page = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_]+(?:/[a-z_]+)*\.py)`", page))
    assert len(named) > 15
    kernel = ROOT / "dimersweep" / "kernel"
    assert not [name for name in named if not (kernel / name).exists()]


@pytest.mark.parametrize("number", [*range(1, 9), "A.1", "A.2", "A.3", "A.4", "A.5", "A.6"])
def test_the_page_of_the_model_maps_every_numbered_equation(number):
    page = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    table = page[page.index("## Map from the paper to the code") :]
    assert f"({number})" in table


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_within_the_repository_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if "://" not in target and not target.startswith("mailto:"):
            assert (page.parent / target).exists(), target
