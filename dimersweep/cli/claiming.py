"""The command for the ledger of the paper's claims."""

from pathlib import Path
from typing import Annotated

import typer

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import Force, Workers

PAGES = (".md",)


def claims(
    *,
    out: Annotated[Path, typer.Option(help="Page to write, in Markdown.")] = Path("docs/claims.md"),
    small: Annotated[bool, typer.Option("--small", help="Coarse grids and short runs.")] = False,
    workers: Workers = None,
    force: Force = False,
) -> None:
    """Recompute every checkable statement of the paper, say where it holds, and write the page of all of them."""
    from dimersweep.storage.outputs import check_output

    page = check_output(out, force=force, what="a page", endings=PAGES)
    with interruptible(page):
        _make(page, small=small, workers=workers)


def _make(page: Path, *, small: bool, workers: int | None) -> None:
    """Recompute the claims, print each, and write the page."""
    from time import perf_counter

    from rich.console import Console
    from rich.table import Table

    from dimersweep.claims import READINGS, Lab, as_markdown, counts, in_any, made, radius_study
    from dimersweep.storage.files import disk_errors, put
    from dimersweep.work.progress import report_compiling

    report_compiling()
    started = perf_counter()
    labs = {reading: Lab(reading, small=small, workers=workers) for reading in READINGS}
    rows = []
    for row in made(labs):
        rows.append(row)
        verdicts = ", ".join(f"{reading} {one.verdict}" for reading, one in row.findings.items())
        typer.echo(f"{len(rows)}: Sect. {row.section}, {verdicts}: {row.statement}", err=True)
    study = radius_study(labs["mu_s"])
    table = Table("Sect.", "the paper says", *(f"held by {reading}" for reading in READINGS), show_lines=True)
    for row in rows:
        cells = [f"{one.verdict}: {one.value}" for one in row.findings.values()]
        table.add_row(row.section, row.statement, *cells)
    Console().print(table)
    with disk_errors(f"out = {page}", ""):
        put(page, [as_markdown(rows, study, small, started).encode()])
    for reading in READINGS:
        typer.echo(f"held by {reading}: {counts(rows, reading)}")
    typer.echo(f"under one of the readings: {in_any(rows)} agree")
    typer.echo(f"page: {page}")
