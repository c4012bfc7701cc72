"""Compute the energy budget of a recorded run.

All energies are those in the room, in which the plate moves. The change of the energy follows from the states alone;
the works of the forces are integrated with the run (``kernel.energy``). The budget sets one beside the other.
"""

from typing import Literal, get_args

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import OF_A_RUN, Column, column, finished, table
from dimersweep.errors import ParameterError
from dimersweep.kernel.batch import Workspace
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.contact_code import CONTACT_STATES, code_of
from dimersweep.kernel.model.event_row import E_CAUSE, E_KIND, E_PERIOD, E_PHASE
from dimersweep.kernel.model.layout import CAUSES, N_STATE, PERIOD, PHASE
from dimersweep.kernel.model.works import WORK_NAMES
from dimersweep.kernel.record import SEGMENT_MODES
from dimersweep.runs.recorded import RunRecord, energies, times_of
from dimersweep.runs.solving import with_works
from dimersweep.symbols import EVENT_QUANTITIES, WORKS

By = Literal["period", "event"]
# share of the energy below which no work flows: works as small as this are round-off, and so would be their `closure`
NO_FLOW = 100 * np.finfo(float).eps
BETWEEN = "motion"  # cause of a row that is a smooth phase, and no impact


def energy_of(record: RunRecord, by: By, space: Workspace) -> xr.Dataset:
    """Return the energy budget of a run, see `Run.energy`. The run is made once more, with the works of its forces."""
    if by not in get_args(By):
        raise ParameterError(f"by = {by!r}: must be one of {', '.join(get_args(By))}")
    record, book = with_works(record, space)
    dm, segments, events = dimer_of(record.row), record.segments, record.events
    n, f = len(segments), record.parameters["f"]
    ends, smooth, flows = book.ends[: n - 1], book.smooth[: n - 1], book.flows[: n - 1]
    struck = np.where((book.leads > 0) & (book.leads < n), book.struck.T, 0.0).T[: len(events)]
    parts_at_starts = np.array(energies(dm, segments[:, :N_STATE]))
    at_starts, at_ends = parts_at_starts.sum(0), np.sum(energies(dm, ends), 0)

    rows = np.flatnonzero(struck.any(1))
    jumps = book.leads[rows]
    last = np.append(np.diff(jumps) > 0, True)[: len(rows)]  # True for the last row of each impact
    jumped = at_starts[1:] - at_ends
    np.subtract.at(jumped, jumps - 1, struck[rows].sum(1))
    moved = at_ends - at_starts[:-1] - smooth.sum(1)
    moved += np.where(np.isin(np.arange(1, n), jumps), 0.0, jumped)

    order = np.argsort(np.concatenate([np.arange(1, n), jumps + 0.5]), kind="stable")

    def joined(of_phases: np.ndarray, of_impacts: np.ndarray) -> np.ndarray:
        return np.concatenate([of_phases, of_impacts])[order]

    works = joined(smooth, struck[rows])
    residual = joined(moved, np.where(last, jumped[jumps - 1], 0.0))
    energy = joined(at_ends, np.where(last, at_starts[jumps], np.nan))
    periods = joined(segments[:-1, PERIOD], events[rows, E_PERIOD]).astype(int)
    changes = np.abs(parts_at_starts - parts_at_starts[:, :1]).max()
    greatest = max(_greatest_flow(smooth, flows, struck), changes)
    moves = greatest > NO_FLOW * np.abs(parts_at_starts).max()
    attributes = {
        "closure": float(np.abs(np.cumsum(residual)).max() / greatest) if moves else 0.0,
        "closure_long_name": (
            "largest sum of the residuals, over the greatest work that flows one way or change of kinetic or potential energy"
        ),
    }
    if by == "period":
        count = int(segments[-1, PERIOD])
        sums = np.zeros((count + 1, works.shape[1] + 1))  # the last row sums what lies beyond the last whole period
        np.add.at(sums, np.minimum(periods, count), np.column_stack([works, residual]))
        works, residual = sums[:-1, :-1], sums[:-1, -1]
        energy, labels, dim = at_starts[np.searchsorted(segments[:, PERIOD], np.arange(1, count + 1))], [], "n"
        index = {"n": column("n", np.arange(count), "number of the forcing period")}
    else:
        phases = joined(segments[:-1, PHASE], events[rows, E_PHASE])
        kinds = joined(code_of(*segments[:-1, SEGMENT_MODES : SEGMENT_MODES + 2].T), events[rows, E_KIND]).astype(int)
        causes = joined(np.full(n - 1, len(CAUSES)), events[rows, E_CAUSE]).astype(int)
        dim = "part"
        labels = [
            Column("kind", EVENT_QUANTITIES["kind"], kinds, CONTACT_STATES),
            Column("cause", EVENT_QUANTITIES["cause"], causes, (*CAUSES, BETWEEN)),
        ]
        index = {"time": column("part", times_of(periods, phases, f), EVENT_QUANTITIES["time"])}
    terms = dict(zip(WORK_NAMES, works.T, strict=True)) | {"energy": energy, "residual": residual}
    columns = [*labels, *(Column(name, quantity, terms[name]) for name, quantity in WORKS.items())]
    made = table((), columns, dim).assign_coords(index).assign_attrs(attributes)
    return finished(made, f"Energy budget {OF_A_RUN}")


def _greatest_flow(smooth: np.ndarray, flows: np.ndarray, struck: np.ndarray) -> float:
    """Return the greatest work of one term in one direction, to the dimer or from it [J].

    A plate that carries the dimer up and down again gives and takes much work, although little is left of it after a
    period.
    """
    net = np.abs(smooth.sum(0) + struck.sum(0))
    return float(np.max(0.5 * (flows.sum(0) + np.abs(struck).sum(0) + net)))
