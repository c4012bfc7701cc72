"""What a claim is, where the claims are kept, and how the ledger of all of them is made and written."""

from collections.abc import Callable, Iterator, Mapping
from time import perf_counter
from typing import NamedTuple

from lab import READINGS, Lab

AGREES, PARTLY, DIFFERS = "agrees", "partly", "differs"
VERDICTS = (AGREES, PARTLY, DIFFERS)


class Finding(NamedTuple):
    """What a claim comes to under one reading.

    Attributes
    ----------
    value : str
        What is found, with its uncertainty or its range.
    verdict : str
        agrees, partly or differs.
    reason : str
        Why it falls short, in one sentence with the number or the derivation that shows it; empty where it agrees.
    """

    value: str
    verdict: str
    reason: str = ""


class Claim(NamedTuple):
    """A statement of the paper with its section, by which criterion it is tried, and what tries it."""

    section: str
    statement: str
    criterion: str
    check: Callable[[Lab], Finding]


class Row(NamedTuple):
    """A claim with what was found under each reading, by its name."""

    section: str
    statement: str
    criterion: str
    findings: dict[str, Finding]


CLAIMS: list[Claim] = []


def claim(
    section: str, statement: str, criterion: str
) -> Callable[[Callable[[Lab], Finding]], Callable[[Lab], Finding]]:
    """Enter a check into the ledger."""

    def enter(check: Callable[[Lab], Finding]) -> Callable[[Lab], Finding]:
        CLAIMS.append(Claim(section, statement, criterion, check))
        return check

    return enter


def found(value: str, holds: bool, *, partly: bool = False, reason: str = "no reason is known") -> Finding:
    """A finding: agrees if it holds, partly if at least that does, else differs; the reason is kept where it falls short."""
    if holds:
        return Finding(value, AGREES)
    return Finding(value, PARTLY if partly else DIFFERS, reason)


def made(labs: Mapping[str, Lab]) -> Iterator[Row]:
    """Try each claim in the order of the paper, in the lab of each reading."""
    for entry in CLAIMS:
        findings = {reading: entry.check(lab) for reading, lab in labs.items()}
        yield Row(entry.section, entry.statement, entry.criterion, findings)


def counts(rows: list[Row], reading: str) -> str:
    """How often each verdict was given under a reading."""
    verdicts = [row.findings[reading].verdict for row in rows]
    return ", ".join(f"{verdicts.count(word)} {word}" for word in VERDICTS)


def in_any(rows: list[Row]) -> int:
    """Number of claims that agree under at least one reading."""
    return sum(any(one.verdict == AGREES for one in row.findings.values()) for row in rows)


def reasons(row: Row) -> str:
    """Why a claim falls short, with the readings under which it does; each reason is given once."""
    readings_of: dict[str, list[str]] = {}
    for reading, one in row.findings.items():
        if one.reason:
            readings_of.setdefault(one.reason, []).append(reading)
    return "; ".join(f"`{' and '.join(readings)}`: {reason}" for reason, readings in readings_of.items())


def _line(*cells: str) -> str:
    """A row of a Markdown table."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


PREAMBLE = """Each statement is tried under two readings of Eq. (4), which bounds the friction of an end that sticks by mu_s. An
impact lasts microseconds, a contact between impacts most of a cycle, and the paper does not say that its program holds an
end in both by the same number. Under `mu_s` it does, as Eq. (4) is printed (`mu_h = mu_s`). Under `mu` stick friction counts
inside impacts only, and an end in lasting contact is held by mu (`mu_h = mu`), as in a program that never sees the slip of a
lasting contact come to exactly zero.

A row says what the paper says, by which criterion it is tried, what this model gives under each reading, and why it falls short
where it does. Nothing was tuned: every number is of the paper's own parameters (Sect. 3) but for those named in its row. What
else the paper leaves open is read in one way throughout: the orbits of Sect. 5 are those at the spin that a start with xdot0
rolls up to, however long a run goes on ([orbits](orbits.md)); R_1 reaches from the fold to the period doubling of the drift;
and the energy per mass is that of the ball that bounces."""


def as_markdown(rows: list[Row], table: list[str], small: bool, started: float) -> str:
    """The ledger as a page: counts, one table, and the study of the radius."""
    size = "the small grids of `claims.py --small`" if small else "the full grids"
    readings = list(rows[0].findings)
    head = [
        "# The paper's claims, recomputed",
        "",
        f"Written by `python benchmarks/evidence/claims.py`, on {size}, in {perf_counter() - started:.0f} s. "
        f"{len(rows)} statements:",
        "",
        *(f"- `{reading}`, {READINGS[reading]}: {counts(rows, reading)};" for reading in readings),
        f"- under at least one of them: {in_any(rows)} agree.",
        "",
        PREAMBLE,
        "",
        _line(
            "Sect.",
            "the paper says",
            *(f"here, `{reading}`" for reading in readings),
            "criterion",
            "why it falls short",
        ),
        "|---" * (4 + len(readings)) + "|",
    ]
    body = [
        _line(
            row.section,
            row.statement,
            *(f"**{row.findings[reading].verdict}**: {row.findings[reading].value}" for reading in readings),
            row.criterion,
            reasons(row),
        )
        for row in rows
    ]
    return "\n".join([*head, *body, "", *table, ""])
