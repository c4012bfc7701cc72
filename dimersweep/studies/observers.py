"""Observers: variables that a study adds to the result of each run, how they are computed, stored and labelled."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Any, ClassVar, NamedTuple

import numpy as np

from dimersweep.cubes.results import Along, Field
from dimersweep.errors import ParameterError
from dimersweep.inputs import check_count
from dimersweep.kernel.batch import N_START, Workspace
from dimersweep.kernel.model.layout import CODE_MODE, CODE_N_PERIODS, CODE_STATUS, M_DRIFT, OK, ROW
from dimersweep.parameters import Parameters
from dimersweep.runs.recorded import states_of
from dimersweep.runs.run import simulate_checked
from dimersweep.runs.shadows import certified
from dimersweep.runs.solving import MAX_RECORDED, RunSettings, Solved, exactly, run_all_patiently, run_row
from dimersweep.symbols import QUANTITIES, STATE_QUANTITIES, Quantity

# numbers in the arrays of one cube, which is held in memory: 160 MB for each variable of floats
MAX_NUMBERS = 20_000_000
STROBED = ("gap_1", "gap_2", "gap_1_rate", "gap_2_rate", "theta_rate", "beta_rate")


class FinishedRuns(NamedTuple):
    """Runs that are over, for observers.

    Attributes
    ----------
    rows : ndarray, shape (n, N_ROW)
        Parameters of the runs.
    how : RunSettings
        Settings of the runs.
    results : ndarray, shape (n,)
        Results, of the type `Study.kind`: `out`, `codes` and the fields of earlier observers are filled in.
    solved : Solved, optional
        Start, end and (if an observer needs it) record of the run, where n = 1 and the run was made by itself.
    given : mapping of str to float, optional
        Parameters that the study sets for such a run; others follow from them or are defaults.
    """

    rows: np.ndarray
    how: RunSettings
    results: np.ndarray
    solved: Solved | None = None
    given: Mapping[str, float] | None = None

    @property
    def start(self) -> np.ndarray | None:
        """State and friction modes at the start of the run, shape (1, N_START); None for the start in its row."""
        return None if self.solved is None else self.solved.start


class Observer(ABC):
    """An addition to the result of each point, besides the numbers of its run; the base of all observers."""

    # parts of a run that the observer needs: "end", "record" or both; with any of them points are run one by one
    needs: ClassVar[frozenset[str]] = frozenset()

    @property
    def fields(self) -> tuple[Field, ...]:
        """Fields that are added to the result of a point; empty if the observer only changes `out` and `codes`."""
        return ()

    def settings(self) -> dict[str, Any]:
        """Return the items that the observer adds to a configuration, as JSON can hold them."""
        return {}

    def check_here(self) -> None:  # noqa: B027 - most take nothing
        """Refuse a process that lacks something that the observer needs; by default it needs nothing.

        Raises
        ------
        ParameterError
            If the process lacks something.
        """

    @abstractmethod
    def observe(self, runs: FinishedRuns, space: Workspace) -> None:
        """Fill in the fields of this observer in ``runs.results``.

        Parameters
        ----------
        runs : FinishedRuns
            Runs that are over.
        space : Workspace
            Scratch arrays for further runs. If a stop is set there meanwhile, the results are not used.
        """


@dataclass(frozen=True)
class Certify(Observer):
    """Confidence in the mode of each point, and error of its orbit, from two more runs; see `certified`."""

    fields = (
        Field("confidence", QUANTITIES["confidence"], "<i8", about="mode"),
        Field("error_estimate", QUANTITIES["error_estimate"], about="mode"),
    )

    def settings(self) -> dict[str, Any]:
        """Return the switch of `sweep` that asks for this observer."""
        return {"certify": True}

    def observe(self, runs: FinishedRuns, space: Workspace) -> None:
        """Make the two further runs of each point, and record confidence and error."""
        results = runs.results
        sure = certified(runs.rows, runs.how, results["out"], results["codes"], space)
        results["confidence"], results["error_estimate"] = sure


@dataclass(frozen=True)
class Strobes(Observer):
    """States at the ends of the `n` forcing periods after the run; NaN where a point has failed."""

    n: int

    @property
    def fields(self) -> tuple[Field, ...]:
        """Fields of the strobes: gaps and rates of the state along the dimension `strobe`."""
        along = Along("strobe", np.arange(self.n), Quantity("1", "number of the forcing period after the run, from 0"))
        states = {name: STATE_QUANTITIES[name] for name in STROBED}
        return tuple(
            Field(f"strobe_{name}", Quantity(units, f"{meaning}, at the start of a forcing period"), along=along)
            for name, (units, meaning, *_) in states.items()
        )

    def settings(self) -> dict[str, Any]:
        """Return the number of strobes, as `sweep` takes it."""
        return {"strobes": self.n}

    def observe(self, runs: FinishedRuns, space: Workspace) -> None:
        """Run each point that is ok once more and `n` periods further, and record its strobes."""
        rtol = runs.how.rtol
        for row, result in zip(runs.rows, runs.results, strict=True):
            if result["codes"][CODE_STATUS] != OK:
                continue
            done = int(result["codes"][CODE_N_PERIODS])
            end = run_row(row, runs.start, exactly(done, rtol), space).end
            more = run_row(row, end.start, exactly(done + self.n, rtol), space, record=True, past=end.past)
            if more.record is None or more.codes[CODE_STATUS] != OK:
                continue
            periods = np.arange(done + 1, done + self.n + 1)
            states = states_of(more.record, periods / more.record.parameters["f"])
            for name in STROBED:
                result[f"strobe_{name}"] = states[name]


@dataclass(frozen=True)
class Longer(Observer):
    """Runs of exactly `periods` forcing periods, in place of runs that stopped when the motion had settled."""

    periods: int

    def settings(self) -> dict[str, Any]:
        """Return the number of forcing periods, as `search` takes it."""
        return {"orbit_periods": self.periods}

    def observe(self, runs: FinishedRuns, space: Workspace) -> None:
        """Replace `out` and `codes` of each point by those of the longer run."""
        how = exactly(self.periods, runs.how.rtol)
        runs.results["out"], runs.results["codes"] = run_all_patiently(runs.rows, how, space)


@dataclass(frozen=True)
class Paths(Observer):
    """Path of the centre of mass of each run that drifts, from a new run of `periods` forcing periods.

    Positions are NaN after the end of a run that fails. The axial velocity is the mean over the last forcing period,
    along the axis from the end that is down to the other one; NaN if no period was completed.

    Parameters
    ----------
    periods : int
        Length of the path in forcing periods.
    per_period : int
        Positions in one forcing period.
    """

    periods: int
    per_period: int = 8

    @property
    def fields(self) -> tuple[Field, ...]:
        """Fields of the path: x and y along the dimension `cycle`, and the axial velocity."""
        cycles = np.arange(self.periods * self.per_period + 1) / self.per_period
        along = Along("cycle", cycles, Quantity("1", "time in forcing periods"))
        velocity = Field("axial_velocity", QUANTITIES["axial_velocity"])
        return (*(Field(name, STATE_QUANTITIES[name], along=along) for name in ("x", "y")), velocity)

    def settings(self) -> dict[str, Any]:
        """Return the length and the density of the path, as `search` takes them."""
        return {"paths": vars(self)}

    def observe(self, runs: FinishedRuns, space: Workspace) -> None:
        """Run each point that drifts anew, and record its path and its axial velocity."""
        for row, result in zip(runs.rows, runs.results, strict=True):
            if result["codes"][CODE_MODE] == M_DRIFT:
                x, y, result["axial_velocity"] = self._of(row, runs.how.rtol, space)
                result["x"][: x.size], result["y"][: y.size] = x, y

    def _of(self, row: np.ndarray, rtol: float, space: Workspace) -> tuple[np.ndarray, np.ndarray, float]:
        """Run a row anew; return the positions x and y [m], each of shape (n,), and the axial velocity [m s-1]."""
        parameters = Parameters(**dict(zip(ROW, row.tolist(), strict=True)))
        run = simulate_checked(parameters, exactly(self.periods, rtol), space)
        if not run.n_periods:
            return np.empty(0), np.empty(0), nan
        states = run.states(np.linspace(0, run.n_periods / parameters.f, run.n_periods * self.per_period + 1))
        x, y, theta = (states[name].values for name in ("x", "y", "theta"))
        dx, dy = x[-1] - x[-1 - self.per_period], y[-1] - y[-1 - self.per_period]
        forward = 1 if run.down_share_1 >= run.down_share_2 else -1
        along = forward * (dy * np.cos(theta[-1]) - dx * np.sin(theta[-1]))
        return x, y, float(along * parameters.f)


@dataclass(frozen=True)
class EndStates(Observer):
    """State and friction modes at the end of each run; later runs are started from them."""

    needs = frozenset({"end"})
    slots = Along("slot", np.arange(N_START), Quantity("1", "slot of the state"))
    fields = (Field("end", Quantity("1", "state and friction modes at the end"), along=slots),)

    def observe(self, runs: FinishedRuns, space: Workspace) -> None:
        """Record the end of the run."""
        assert runs.solved is not None  # since `needs` names the end
        runs.results["end"] = runs.solved.onward


def needs_of(observers: Iterable[Observer]) -> frozenset[str]:
    """Return the parts of a run (end, record) that any of the observers needs."""
    return frozenset[str]().union(*(observer.needs for observer in observers))


def strobes_of(n: Any, points: int) -> tuple[Observer, ...]:
    """Return the observer of `n` strobes of each point in a tuple; an empty tuple for n = 0.

    Raises
    ------
    ParameterError
        If `n` is no number of strobes, or all strobes of the cube are more than `MAX_NUMBERS`.
    """
    kept = 0 if n == 0 else check_count("strobes", n)
    if points * kept > MAX_NUMBERS:
        raise ParameterError(f"strobes = {kept}: of {points} points; one cube may hold {MAX_NUMBERS} strobes")
    return (Strobes(kept),) if kept else ()


def paths_of(points: int, periods: Any, per_period: Any = 8) -> Paths:
    """Return the observer of the paths of `points` points.

    Raises
    ------
    ParameterError
        If a number is not allowed, or all positions of the cube are more than `MAX_NUMBERS`.
    """
    paths = Paths(check_count("paths.periods", periods, MAX_RECORDED), check_count("paths.per_period", per_period))
    positions = paths.periods * paths.per_period + 1
    if points * positions > MAX_NUMBERS:
        raise ParameterError(
            f"paths: {points} of {positions} positions each; one cube may hold {MAX_NUMBERS} positions"
        )
    return paths
