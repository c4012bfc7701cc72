"""This machine gives the bits of the file that is the promise of this version of the arithmetic."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from dimersweep import simulate
from dimersweep.kernel.compiler.pipelines import PYTHON, pipeline
from dimersweep.kernel.model.layout import N_OUT
from dimersweep.kernel.record import new_record, rows_of
from dimersweep.runs.recorded import EVENT
from tests.checks.verbs import keep_one_nan

PROGRAM = Path(__file__).parents[1] / "benchmarks" / "evidence" / "other_processors.py"
FEW = 3  # without the compiler


@pytest.fixture(scope="module")
def program():
    spec = importlib.util.spec_from_file_location("other_processors", PROGRAM)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_this_machine_gives_the_bits_of_all_others(program):
    """Of 720 runs of all kinds; also without the compiler, which takes too long for more than a few."""
    _, promised = program.read(program.PROMISE)
    assert len(promised) == 720
    compiled = pipeline() != PYTHON
    found = dict(program.runs() if compiled else program.runs(720, first=FEW))
    assert len(found) == (720 if compiled else FEW)
    assert {name: line for name, line in found.items() if promised[name] != line} == {}


def test_what_differs_is_counted(program, capsys):
    asked, other = np.arange(3.0), np.arange(1.0, 4.0)
    one = {"run 0": program.told(asked, [1, 2], [0.1, np.nan]), "run 1": program.told(asked, [1, 3], [0.1, 0.2])}
    two = {"run 0": program.told(asked, [1, 2], [0.1, np.nan]), "run 1": program.told(asked, [1, 3], [0.1, 0.3])}
    three = {"run 0": program.told(asked, [1, 4], [0.1, 0.2]), "run 1": program.told(other, [1, 3], [0.1, 0.2])}
    assert list(program.compare(one, two)) == ["runs: 1 of 2 the same bits, 2 the same codes, 2 the same scenes"]
    assert list(program.compare(one, three)) == ["runs: 0 of 2 the same bits, 0 the same codes, 1 the same scenes"]


def test_another_nan_is_another_result(program):
    """The sign of 0/0 is the processor's, and must not get into a result."""
    odd = -np.array([np.nan])
    assert program.told([1.0], [1], odd) != program.told([1.0], [1], [np.nan])


def odd(shape):
    """No numbers, with the sign that 0/0 has on x86-64."""
    return np.full(shape, -np.nan)


def test_what_is_no_number_has_one_form_where_it_is_stored():
    """In outcomes, in the rows of a record, which files of runs hold, and in the tables that are made of them."""
    assert odd(1).tobytes() != np.array([np.nan]).tobytes()
    outcome = odd(N_OUT)
    keep_one_nan(outcome)
    record = new_record(3)
    record.events[:], record.segments[:], record.counts[:] = odd(record.events.shape), odd(record.segments.shape), 2
    run = simulate(Gamma=1.5, periods=2)
    run.record("events").events[:, EVENT.index("slip_1_a")] = odd(len(run.record("events").events))
    slip = run.events.slip_1_a.values
    for each in (outcome, *rows_of(record), slip):
        assert each.size and each.tobytes() == np.full(each.shape, np.nan).tobytes()
    assert np.signbit(record.events[2]).all(), "no row"
