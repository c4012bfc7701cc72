"""What a plan tells of a search or a map is what these then take."""

import numpy as np
import pytest

from dimersweep.studies import refine as refining
from dimersweep.studies.planning import plan
from dimersweep.studies.refine import refine
from dimersweep.studies.search import search, study_of
from tests.fakes import banded_kernel, fake_run_many
from tests.seams import set_clock, use_kernel
from tests.test_refine import COARSE

GRID = {"f": np.linspace(0.2, 9, 30), "e": [0.5, 0.6, 0.7], "beta0": np.linspace(0.03, 0.3, 19)}


@pytest.fixture
def made(monkeypatch):
    """Have the kernel of a test count its runs, the time of each being one second."""
    runs = []

    def use(kernel):
        def counting(*arguments, until, space=None):
            runs.append(kernel(*arguments, until=until))
            return runs[-1]

        use_kernel(monkeypatch, counting)
        set_clock(monkeypatch, lambda: float(sum(runs)))
        monkeypatch.setattr("dimersweep.work.tiles.OVERTIME", np.inf)
        monkeypatch.setattr("dimersweep.studies.planning.perf_counter", lambda: 0.0)  # a sample is whole, however slow
        return runs

    return use


@pytest.mark.parametrize(("ask", "close"), [("first", 1e-12), ("fraction", 1e-12), ("any", 0.25)])
def test_a_search_takes_the_time_that_was_planned(made, ask, close):
    made(fake_run_many)
    spec = study_of(GRID, None, over="beta0", ask=ask, mode="drift", periods=5, rtol=1e-8)
    told = plan(spec, 1)
    runs = search(GRID, over="beta0", ask=ask, periods=5, progress=False)["n_runs"].sum()
    assert told.to_run == 90 == told.times.size
    assert told.seconds[0] == pytest.approx(float(runs), rel=close)
    assert told.seconds[1] == 0  # every point was in the sample


def test_a_map_takes_the_points_and_the_time_that_were_planned_and_at_most_a_third_more(made):
    made(banded_kernel)
    halvings = {"e": 2, "Gamma": 5}
    spec = study_of(COARSE, None, over="beta0", ask="any", mode="drift", periods=5, rtol=1e-8)
    told = plan(refining.study_of(spec, halvings, None), 1)
    cube = refine(COARSE, halvings=halvings, over="beta0", periods=5, progress=False)
    assert told.times.size == told.sample.units == 20
    assert told.to_run <= int(cube["computed"].sum()) <= 1.33 * told.to_run
    assert told.seconds[0] <= float(cube["n_runs"].sum()) <= 1.33 * told.seconds[0]
