"""The claims ledger: every statement of the paper that can be tried, what it comes to here, and whether the two agree."""

from dimersweep.claims import sect3, sect4, sect5  # each enters its claims, in the order of the paper
from dimersweep.claims.lab import READINGS, Lab
from dimersweep.claims.ledger import CLAIMS, Claim, Finding, Row, as_markdown, counts, found, in_any, made
from dimersweep.claims.sect5 import radius_study

__all__ = [
    "CLAIMS",
    "READINGS",
    "Claim",
    "Finding",
    "Lab",
    "Row",
    "as_markdown",
    "counts",
    "found",
    "in_any",
    "made",
    "radius_study",
    "sect3",
    "sect4",
    "sect5",
]
