"""What a claim is, where the claims are kept, and how the ledger of all of them is made and told."""

from collections.abc import Callable, Iterator
from time import perf_counter
from typing import NamedTuple

from dimersweep.claims.lab import Lab

AGREES, PARTLY, DIFFERS = "agrees", "partly", "differs"


class Finding(NamedTuple):
    """What a claim comes to here.

    Attributes
    ----------
    value : str
        What is found, with its uncertainty or its range.
    verdict : str
        agrees, partly or differs.
    why : str
        The criterion of the verdict, or the evidence for a difference.
    """

    value: str
    verdict: str
    why: str


class Claim(NamedTuple):
    """A statement of the paper with its section, and what tries it."""

    section: str
    statement: str
    check: Callable[[Lab], Finding]


class Row(NamedTuple):
    """A claim with what was found."""

    section: str
    statement: str
    finding: Finding


CLAIMS: list[Claim] = []


def claim(section: str, statement: str) -> Callable[[Callable[[Lab], Finding]], Callable[[Lab], Finding]]:
    """Enter a check into the ledger."""

    def enter(check: Callable[[Lab], Finding]) -> Callable[[Lab], Finding]:
        CLAIMS.append(Claim(section, statement, check))
        return check

    return enter


def verdict(holds: bool, partly: bool = False) -> str:
    """agrees if it holds, partly if at least that does, else differs."""
    return AGREES if holds else PARTLY if partly else DIFFERS


def made(lab: Lab) -> Iterator[Row]:
    """Try each claim in the order of the paper."""
    for entry in CLAIMS:
        yield Row(entry.section, entry.statement, entry.check(lab))


def _line(*cells: str) -> str:
    """A row of a Markdown table."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def as_markdown(rows: list[Row], table: list[str], lab: Lab, started: float) -> str:
    """The ledger as a page: counts, one table, and the study of the radius."""
    counts = {word: sum(row.finding.verdict == word for row in rows) for word in (AGREES, PARTLY, DIFFERS)}
    told = ", ".join(f"{count} {word}" for word, count in counts.items())
    size = "the small grids of `dimersweep claims --small`" if lab.small else "the full grids"
    head = [
        "# The paper's claims, recomputed",
        "",
        f"Written by `dimersweep claims`, on {size}, in {perf_counter() - started:.0f} s. {len(rows)} statements: {told}.",
        "Each row says what the paper says, what this model gives, and by which criterion the two are compared. Nothing",
        "was tuned: every number is of the paper's own parameters (Sect. 3) but for those named in its row.",
        "",
        "| Sect. | the paper says | here | verdict | criterion or evidence |",
        "|---|---|---|---|---|",
    ]
    body = [
        _line(row.section, row.statement, row.finding.value, f"**{row.finding.verdict}**", row.finding.why)
        for row in rows
    ]
    return "\n".join([*head, *body, "", *table, ""])
