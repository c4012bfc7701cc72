"""The energy book of a run, where it is wanted.

It has the works of the contact forces in each smooth phase and in each impact.
"""

from typing import Any, NamedTuple

import numpy as np

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import Y
from dimersweep.kernel.model.layout import FREE, N_STATE
from dimersweep.kernel.model.works import N_CONTACT_WORK, N_WORK, STRUCK_ROWS
from dimersweep.kernel.numerics.steps import copy


class Book(NamedTuple):
    """Rows with the works beside those of a record, none if no works are wanted; all are filled in place [J]."""

    smooth: Any  # works in each smooth phase, shape (n, N_WORK)
    flows: Any  # sums of the sizes of the works in its steps, shape (n, N_WORK): energy that flows either way
    ends: Any  # state at the end of each smooth phase, before an impact there, shape (n, N_STATE)
    struck: Any  # works of each event, shape (k, N_WORK): zero but for impacts and closes of chatters
    leads: Any  # number of the smooth phase to which such an event leads, shape (k,), int64


def new_book(rows: int) -> Book:
    """Return an empty book for a record with `rows` rows for events and for smooth phases each."""
    works = [np.zeros((rows, N_WORK)) for _ in range(3)]
    return Book(works[0], works[1], np.zeros((rows, N_STATE)), works[2], np.zeros(rows, np.int64))


@compiled
def begin_phase(y, work):
    """Set the works of the contact phase to zero."""
    flows = work.step[0].flows
    for k in range(N_CONTACT_WORK):
        y[Y.work + k], flows[k] = 0.0, 0.0


@compiled
def keep_phase(book, n, state, modes, y, work):
    """Add the works of a part of the smooth phase n to its row, and keep the state at the end of the part.

    y is the contact state there.
    """
    if not 0 <= n < book.ends.shape[0]:
        return
    copy(state, book.ends[n], N_STATE)
    if modes[0] != FREE or modes[1] != FREE:
        flows = work.step[0].flows
        for k in range(N_CONTACT_WORK):
            book.smooth[n, k] += y[Y.work + k]
            book.flows[n, k] += flows[k]


@compiled
def keep_struck(book, first, last, n, rows):
    """Copy the works of the events from `first` up to `last`, which lead to the smooth phase n, into their rows."""
    struck = rows[rows.shape[0] - STRUCK_ROWS :]
    for k in range(first, min(last, book.leads.shape[0])):
        book.leads[k] = n
        copy(struck[k - first], book.struck[k], N_WORK)
