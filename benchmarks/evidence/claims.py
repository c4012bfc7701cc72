"""The paper's statements, tried one by one: ``python benchmarks/evidence/claims.py [--small]`` writes ``docs/claims.md``.

Every statement that can be tried is entered in ``claims/``, in the order of the paper, with its criterion. Each is tried under
two readings of the paper's stick friction, and the page says what it comes to and why it falls short where it does. On the
full grids that takes a minute or two.
"""

import argparse
import sys
from pathlib import Path
from time import perf_counter

HERE = Path(__file__).resolve()
PAGE = HERE.parents[2] / "docs" / "claims.md"
sys.path.insert(0, str(HERE.with_suffix("")))  # the folder of the claims


def main(arguments: list[str] | None = None) -> None:
    """Try every claim, print what it comes to, and write the page."""
    import sect3  # noqa: F401  # each enters its claims, in the order of the paper
    import sect4  # noqa: F401
    from lab import READINGS, Lab
    from ledger import as_markdown, counts, in_any, made
    from sect5 import radius_study

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=PAGE, help="page to write")
    parser.add_argument("--small", action="store_true", help="coarse grids and short runs")
    parser.add_argument("--workers", type=int, help="threads; one for each core by default")
    given = parser.parse_args(arguments)
    started = perf_counter()
    labs = {reading: Lab(reading, small=given.small, workers=given.workers) for reading in READINGS}
    rows = []
    for row in made(labs):
        rows.append(row)
        told = "; ".join(f"{reading} {one.verdict}: {one.value}" for reading, one in row.findings.items())
        print(f"{len(rows)}: Sect. {row.section}, {row.statement}: {told}", flush=True)
    page = as_markdown(rows, radius_study(labs["mu_s"]), given.small, started)
    given.out.write_text(page, encoding="utf-8")
    for reading in READINGS:
        print(f"held by {reading}: {counts(rows, reading)}")
    print(f"under one of the readings: {in_any(rows)} agree\npage: {given.out}")


if __name__ == "__main__":
    main()
