"""The page on faults has every attack that there is, and a run fills it."""

import re
from importlib import import_module
from pathlib import Path

import faults

PAGE = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
TABLE = "| attack | the same | refused | not held |\n|---|---|---|---|\n"


def rows_of(page):
    """Names of the attacks in the table of a page, with what stands in their rows."""
    table = page.partition(TABLE)[2].partition("\n\n")[0]
    return {
        name.strip(): tuple(map(str.strip, more))
        for _, name, *more, _ in (row.split("|") for row in table.splitlines())
    }


def test_the_page_has_every_attack():
    for name in ("fault_attacks", "fault_cubes", "fault_clusters"):
        import_module(name)
    assert set(rows_of(PAGE)) == set(import_module("fault_scene").ATTACKS)


def test_a_run_fills_the_page():
    names = list(rows_of(PAGE))
    verdicts = {name: {"same": k, "refused": 5 - k % 6} for k, name in enumerate(names)}
    filled = faults.with_results(
        PAGE, "7 s\n3 attacks, 15 times in all, 9 random kills: none did not hold", "abc1234", verdicts
    )
    assert rows_of(filled) == {name: (str(k), str(5 - k % 6), "0") for k, name in enumerate(names)}
    assert "```\n7 s\n3 attacks, 15 times in all, 9 random kills: none did not hold\n```" in filled
    assert re.findall(r"revision `(\w+)`", filled) == ["abc1234"]

    def without(page):
        page = re.sub(r"revision `\w+`|```\n[^`]* random kills: [^`]*```", "", page)
        return page.replace(page.partition(TABLE)[2].partition("\n\n")[0], "")

    assert without(filled).split() == without(PAGE).split()
