"""The command for the ledger of the paper's claims."""

from pathlib import Path
from typing import Annotated

import typer

from dimersweep.cli.options import Force, Workers


def claims(
    *,
    out: Annotated[Path, typer.Option(help="Page to write, in Markdown.")] = Path("docs/claims.md"),
    small: Annotated[bool, typer.Option("--small", help="Coarse grids and short runs.")] = False,
    workers: Workers = None,
    force: Force = False,
) -> None:
    """Recompute every checkable statement of the paper, tell where it holds, and write the page of all of them."""
    from dimersweep.storage.netcdf import check_writable

    page = check_writable(out, force=force)
    from time import perf_counter

    from rich.console import Console
    from rich.table import Table

    from dimersweep.claims import Lab, as_markdown, made, radius_study
    from dimersweep.work.progress import tell_of_compiling

    tell_of_compiling()
    started, lab, rows = perf_counter(), Lab(small=small, workers=workers), []
    for row in made(lab):
        rows.append(row)
        typer.echo(f"{len(rows)}: Sect. {row.section}, {row.finding.verdict}: {row.statement}", err=True)
    study = radius_study(lab)
    table = Table("Sect.", "the paper says", "here", "verdict", show_lines=True)
    for row in rows:
        table.add_row(row.section, row.statement, row.finding.value, row.finding.verdict)
    Console().print(table)
    page.write_text(as_markdown(rows, study, lab, started), encoding="utf-8")
    typer.echo(f"page: {page}")
