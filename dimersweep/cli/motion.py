"""The commands for exponents and power of the motion that a start leads to."""

from typing import Annotated

import typer

from dimersweep.cli.drawing import check_files, keep
from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import Accuracy, Force, Table, number_option, option
from dimersweep.symbols import WORKS

Before = Annotated[int, number_option("Forcing periods that are run before.", int)]


def lyapunov(
    context: typer.Context,
    *,
    before: Before = 200,
    periods: Annotated[int, number_option("Forcing periods that count.", int)] = 1000,
    every: Annotated[bool, option("Print all exponents, not the largest alone.", "--all")] = False,
    rtol: Accuracy = 1e-8,
) -> None:
    """Print the largest Lyapunov exponent of the motion that a start leads to, or all of them."""
    tell, parameters = context.obj
    tell.report_compiling()
    from dimersweep.runs.growth import lyapunov, spectrum
    from dimersweep.runs.simulating import simulate

    run = simulate(periods=before, rtol=rtol, **parameters)
    found = spectrum(run, periods) if every else lyapunov(run, periods)
    columns = found[:-1] if every else [[each] for each in found[:-1]]
    tell(f"mode after {before} periods: {run.mode}", mode=run.mode)
    units = {"exponent": "1/s", "error": "1/s", "per_period": "", "periods": ""}
    tell.rows("lyapunov", units, [(*map(float, row), found.periods) for row in zip(*columns, strict=True)])


def power(
    context: typer.Context,
    *,
    before: Before = 200,
    periods: Annotated[int, number_option("Forcing periods whose mean is taken.", int)] = 100,
    rtol: Accuracy = 1e-8,
    out: Table = None,
    force: Force = False,
) -> None:
    """Print the power that the plate gives a dimer, and what restitution and slip take of it, at each end."""
    tell, parameters = context.obj
    check_files(out, None, force=force)
    with interruptible(out):
        tell.report_compiling()
        from dimersweep.runs.simulating import simulate

        run = simulate(periods=before + periods, rtol=rtol, **parameters)
        budget = run.energy()
        works = budget.isel(n=slice(-periods, None)).mean("n") * run.parameters["f"]
        rows = [(name, float(works[name])) for name in WORKS if name != "energy"]
        tell(f"mode: {run.mode}; the budget closes to {budget.closure:.1e}", mode=run.mode, closure=budget.closure)
        tell.rows("power", {"term": "", "power": "W"}, rows)
        keep(tell, budget, out, None, force=force)
