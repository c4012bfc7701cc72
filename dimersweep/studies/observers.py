"""Observers: what a study adds to the numbers of each point's run, how it is computed, and how it is kept and labelled."""

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

MAX_NUMBERS = 20_000_000  # of strobes, or of positions, in one cube, which is held in memory
STROBED = ("gap_1", "gap_2", "gap_1_rate", "gap_2_rate", "theta_rate", "beta_rate")


class Ran(NamedTuple):
    """Runs that were made, for observers to look at.

    Attributes
    ----------
    rows : ndarray, shape (n, N_ROW)
        Their parameters.
    how : RunSettings
    results : ndarray, shape (n,)
        Of the study's kind: `out` and `codes` are there, and what observers before have filled in.
    solved : Solved, optional
        Of a run that was made by itself: its start, its end, and what an observer has asked for.
    given : mapping of str to float, optional
        Of such a run, the parameters that its study gives.
    """

    rows: np.ndarray
    how: RunSettings
    results: np.ndarray
    solved: Solved | None = None
    given: Mapping[str, float] | None = None

    @property
    def start(self) -> np.ndarray | None:
        """State and friction modes that it started from, shape (1, N_START), in place of the start in its row."""
        return None if self.solved is None else self.solved.start


class Observer(ABC):
    """What is known of each point besides the numbers of its run."""

    # of each run: its end or its record, for which points are run one by one
    needs: ClassVar[frozenset[str]] = frozenset()

    @property
    def fields(self) -> tuple[Field, ...]:
        """What it adds to the result of a point; nothing, if it changes that of the run."""
        return ()

    def settings(self) -> dict[str, Any]:
        """What it adds to a configuration, as JSON can hold it."""
        return {}

    def check_here(self) -> None:  # noqa: B027 - most take nothing
        """Refuse a process that lacks something it takes.

        Raises
        ------
        ParameterError
        """

    @abstractmethod
    def observe(self, ran: Ran, space: Workspace) -> None:
        """Fill in its fields of ``ran.results``.

        Parameters
        ----------
        ran : Ran
        space : Workspace
            Scratch arrays for further runs. If they are stopped meanwhile, what is filled in is not used.
        """


@dataclass(frozen=True)
class Certify(Observer):
    """How sure the mode of each point is, from two more runs; see `certified`."""

    fields = (
        Field("confidence", QUANTITIES["confidence"], "<i8", about="mode"),
        Field("error_estimate", QUANTITIES["error_estimate"], about="mode"),
    )

    def settings(self) -> dict[str, Any]:
        """See `Observer`."""
        return {"certify": True}

    def observe(self, ran: Ran, space: Workspace) -> None:
        """See `Observer`."""
        results = ran.results
        sure = certified(ran.rows, ran.how, results["out"], results["codes"], space)
        results["confidence"], results["error_estimate"] = sure


@dataclass(frozen=True)
class Strobes(Observer):
    """The states at the starts of the next `n` forcing periods; NaN where a point has failed."""

    n: int

    @property
    def fields(self) -> tuple[Field, ...]:
        """See `Observer`."""
        along = Along("strobe", np.arange(self.n), Quantity("1", "forcing periods after the run"))
        states = {name: STATE_QUANTITIES[name] for name in STROBED}
        return tuple(
            Field(f"strobe_{name}", Quantity(units, f"{meaning}, at the start of a forcing period"), along=along)
            for name, (units, meaning, *_) in states.items()
        )

    def settings(self) -> dict[str, Any]:
        """See `Observer`."""
        return {"strobes": self.n}

    def observe(self, ran: Ran, space: Workspace) -> None:
        """See `Observer`."""
        rtol = ran.how.rtol
        for row, result in zip(ran.rows, ran.results, strict=True):
            if result["codes"][CODE_STATUS] != OK:
                continue
            done = int(result["codes"][CODE_N_PERIODS])
            end = run_row(row, ran.start, exactly(done, rtol), space).end
            more = run_row(row, end.start, exactly(done + self.n, rtol), space, record=True, past=end.past)
            if more.record is None or more.codes[CODE_STATUS] != OK:
                continue
            periods = np.arange(done + 1, done + self.n + 1)
            states = states_of(more.record, periods / more.record.parameters["f"])
            for name in STROBED:
                result[f"strobe_{name}"] = states[name]


@dataclass(frozen=True)
class Longer(Observer):
    """The same runs for so many forcing periods, in place of those that ended when the motion had settled."""

    periods: int

    def settings(self) -> dict[str, Any]:
        """See `Observer`."""
        return {"orbit_periods": self.periods}

    def observe(self, ran: Ran, space: Workspace) -> None:
        """See `Observer`."""
        how = exactly(self.periods, ran.how.rtol)
        ran.results["out"], ran.results["codes"] = run_all_patiently(ran.rows, how, space)


@dataclass(frozen=True)
class Paths(Observer):
    """The path of the centre of mass of each run that drifts, made anew for so many forcing periods.

    Positions are NaN after the end of a run that fails. The axial velocity is the mean over the last forcing period, along the
    axis from the end that is down to the other one; NaN if no period was completed.

    Parameters
    ----------
    periods : int
        Forcing periods.
    per_period : int
        Positions in one of them.
    """

    periods: int
    per_period: int = 8

    @property
    def fields(self) -> tuple[Field, ...]:
        """See `Observer`."""
        cycles = np.arange(self.periods * self.per_period + 1) / self.per_period
        along = Along("cycle", cycles, Quantity("1", "time in forcing periods"))
        velocity = Field("axial_velocity", QUANTITIES["axial_velocity"])
        return (*(Field(name, STATE_QUANTITIES[name], along=along) for name in ("x", "y")), velocity)

    def settings(self) -> dict[str, Any]:
        """See `Observer`."""
        return {"paths": vars(self)}

    def observe(self, ran: Ran, space: Workspace) -> None:
        """See `Observer`."""
        for row, result in zip(ran.rows, ran.results, strict=True):
            if result["codes"][CODE_MODE] == M_DRIFT:
                x, y, result["axial_velocity"] = self._of(row, ran.how.rtol, space)
                result["x"][: x.size], result["y"][: y.size] = x, y

    def _of(self, row: np.ndarray, rtol: float, space: Workspace) -> tuple[np.ndarray, np.ndarray, float]:
        """Positions [m] of the run of a row, and its axial velocity [m s-1]."""
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
    """State and friction modes at the end of each run."""

    needs = frozenset({"end"})
    slots = Along("slot", np.arange(N_START), Quantity("1", "slot of the state"))
    fields = (Field("end", Quantity("1", "state and friction modes at the end"), along=slots),)

    def observe(self, ran: Ran, space: Workspace) -> None:
        """See `Observer`."""
        assert ran.solved is not None  # it has asked for that
        ran.results["end"] = ran.solved.onward


def needs_of(observers: Iterable[Observer]) -> frozenset[str]:
    """What observers ask for."""
    return frozenset[str]().union(*(observer.needs for observer in observers))


def strobes_of(n: Any, points: int) -> tuple[Observer, ...]:
    """The observer of so many strobes of each point; none for 0.

    Raises
    ------
    ParameterError
        If that is no number of strobes, or they are more than memory may hold.
    """
    kept = 0 if n == 0 else check_count("strobes", n)
    if points * kept > MAX_NUMBERS:
        raise ParameterError(f"strobes = {kept}: of {points} points; one cube may hold {MAX_NUMBERS} strobes")
    return (Strobes(kept),) if kept else ()


def paths_of(points: int, periods: Any, per_period: Any = 8) -> Paths:
    """The observer of paths of so many points.

    Raises
    ------
    ParameterError
        If a number is not allowed, or they are more than memory may hold.
    """
    paths = Paths(check_count("paths.periods", periods, MAX_RECORDED), check_count("paths.per_period", per_period))
    positions = paths.periods * paths.per_period + 1
    if points * positions > MAX_NUMBERS:
        raise ParameterError(
            f"paths: {points} of {positions} positions each; one cube may hold {MAX_NUMBERS} positions"
        )
    return paths
