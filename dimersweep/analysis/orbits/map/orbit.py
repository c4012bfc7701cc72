"""Periodic orbits: fixed points of the fast part at a spin, with their circle, stability and tables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from os import PathLike
from typing import TYPE_CHECKING, NamedTuple, Unpack

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.analysis.orbits.map.solution import SlowMotion, Solution, multipliers_of, slow_motion_at
from dimersweep.cubes.cube import Column, fixed_coordinates, table
from dimersweep.inputs import check_count, check_rtol
from dimersweep.kernel.model.layout import CODE_WORDS, DI_ENDS, State
from dimersweep.runs.period_map import NAMES
from dimersweep.runs.run import Run, as_run
from dimersweep.runs.solving import exactly, run_row
from dimersweep.runs.starting import start_of
from dimersweep.symbols import ORBIT_NAMES, QUANTITIES, START, Quantity, conditions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dimersweep.plots.style import Look

SHOWN_PERIODS = 12  # periods of an orbit in its picture: so few that a run from an unstable orbit has not left it yet
CIRCLE = 1e-12  # turn in a period that counts as zero [rad]: round-off of a motion in a plane
PLANE = 1e-10  # spin that counts as zero, in units of the section: a sustained spin of 0 is located so well
CHORDS = 16  # chords of the path in a forcing period: with these the radius of the base case's path is known to 1e-6 m


class MeanPath(NamedTuple):
    """The circle, or the straight line, about which the centre of mass swings.

    Attributes
    ----------
    radius : float
        Radius of the circle, inf for a straight path [m].
    speed : float
        Mean speed along the circle or the line [m s-1].
    bend : complex
        Rate of change of the mean velocity over the velocity, in axes that turn with the dimer [s-1]. The real part is
        its growth, the imaginary part its turn in the sense of the path.
    phases : ndarray, shape (n,)
        Phases of the plate at which `swing` is given, the same in each forcing period [rad].
    swing : ndarray of complex, shape (n,)
        Distance of the centre of mass from the mean path at these phases, over the radius [1]: outwards (real part),
        and ahead (imaginary part).
    """

    radius: float
    speed: float
    bend: complex
    phases: np.ndarray
    swing: np.ndarray


def path_of(m: ReturnMap, z: np.ndarray) -> MeanPath:
    """Return the mean path of a motion over its period, from a point of the section on.

    The chords of the parts of the period are summed as in `kernel.mean_path`. The bend comes from the sum of the next
    period.
    """
    count = CHORDS * m.periods
    parts = np.arange(2 * count + 1) / count
    at = TURN * m.periods * parts
    _, _, passage = m.recorder.run(m.row, m.state(z), 2 * m.periods, m.rtol, path=True)
    states, _ = m.states(passage, at)
    s = State(*states.T)
    places = s.x1 + 1j * s.y1 - 1j * m.dimer.p1.h * np.cos(m.dimer.beta_0 + s.dip) * np.exp(1j * s.theta)
    turn, later = np.diff(s.theta[::count]).tolist()
    step = np.repeat([turn, later], count) / count
    chords = np.exp(-1j * (np.cumsum(step) - 0.5 * step)) * np.diff(places)
    way, next_way = chords.reshape(2, count).sum(axis=1)
    time = m.periods / m.parameters["f"]
    speed = float(abs(way) / time / np.sinc(step[0] / TURN))
    phases = np.mod(m.phase + at[:count], TURN)
    if abs(turn) <= CIRCLE:
        return MeanPath(np.inf, speed, 0j, phases, np.zeros(count, complex))
    bend = complex(next_way / way - 1) / time
    middle = places[0] - (places[count] - places[0]) / np.expm1(1j * turn)
    radii = (places[:count] - middle) * np.exp(-1j * turn * parts[:count])
    swing = radii / radii.mean() - 1
    if turn < 0:
        bend, swing = bend.conjugate(), swing.conj()
    return MeanPath(speed * time / abs(turn), speed, bend, phases, swing)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class PeriodicOrbit:
    """A periodic motion of the fast part at a given axial spin, stable or not.

    Attributes
    ----------
    parameters : dict
        Parameters of the model.
    periods : int
        Forcing periods after which the motion repeats.
    spin : float
        Axial spin after the double impact or, without one, after the last impact of the end that is in the air for
        longer [rad s-1], as in `Run.orbit`. If the motion has several such impacts, it is the spin after the last one.
    radius : float
        Equivalent radius (11), `speed` over precession rate; NaN for a motion in a plane [m].
    path_radius : float
        Radius of the mean path of the centre of mass, as a camera sees it; NaN for a motion in a plane [m].
    path_speed : float
        Speed along the mean path [m s-1].
    period : float
        Time once round the circle [s], for either radius; NaN for a motion in a plane.
    zeta : float
        Angle from the axis to the velocity of the centre of mass after that impact [rad].
    speed : float
        Speed of the centre of mass after that impact [m s-1].
    precession_rate : float
        Mean rate of theta [rad s-1].
    impact_phase : float
        Phase of that impact in cycles of the plate, in [0, 1) [1].
    di_end : str
        Friction after that impact, of the end that is down and of the end that bounces; none if it is no double impact.
    spin_drift, precession_rate_drift : float
        Change of the spin and of the precession rate per forcing period along the slow family [rad s-1].
    multipliers : ndarray of complex
        Multipliers of the fast part, over the period of the motion, the largest first [1]. A single 0 if the motion
        keeps nothing but the spin from period to period.
    slow_multiplier : float
        Multiplier of the direction along the family [1].
    stable : bool
        True if all multipliers of the fast part are below 1 in size.
    residual : float
        Largest difference between the motion and its image, but for the slow drift along the family, in units of the
        section.
    sequence : str
        Symbol sequence: the contact states and impacts that follow one another in a period (docs/orbits.md).
    cost : float
        Forcing periods of the map that the search took.
    others : tuple of PeriodicOrbit
        Unstable orbits of the same spin that `orbits.find` found before this one.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> orbit = orbits.find(spin=100.0)
    >>> orbit.stable, round(orbit.radius, 3)
    (True, 4.259)
    """

    parameters: dict[str, float]
    periods: int
    spin: float
    radius: float
    period: float
    zeta: float
    speed: float
    precession_rate: float
    impact_phase: float
    di_end: str
    spin_drift: float
    precession_rate_drift: float
    multipliers: np.ndarray
    slow_multiplier: float
    stable: bool
    residual: float
    sequence: str
    cost: float
    rtol: float
    fixed: Solution = field(repr=False)
    slow_motion: SlowMotion = field(repr=False)
    others: "tuple[PeriodicOrbit, ...]" = ()

    def __repr__(self) -> str:
        kind = "stable" if self.stable else "unstable"
        others = f", {len(self.others)} other at this spin" if self.others else ""
        return (
            f"<PeriodicOrbit: period {self.periods}, {kind}, spin {self.spin:.6g} rad/s, {circle_of(self.radius)}, "
            f"zeta {self.zeta:.6g} rad, residual {self.residual:.1e}{others}>"
        )

    def _repr_html_(self) -> str:
        from dimersweep.plots.tables import orbit_table

        return orbit_table(self)

    @cached_property
    def path(self) -> MeanPath:
        """Mean path of the centre of mass."""
        return path_of(self.fixed.map, self.slow_motion.z)

    @property
    def path_radius(self) -> float:
        """Radius of the mean path of the centre of mass; NaN for a motion in a plane [m]."""
        return self.path.radius if self.precession_rate else float("nan")

    @property
    def path_speed(self) -> float:
        """Speed along the mean path of the centre of mass [m s-1]."""
        return self.path.speed

    def run(self, periods: int = 100, rtol: float = 1e-8, record: bool = True) -> Run:
        """Run the dimer from the state of the orbit at the plate's phase `phi0` of its parameters.

        Parameters
        ----------
        periods : int
            Forcing periods.
        rtol : float
            Accuracy of the run [1].
        record : bool
            Record the events and smooth phases.

        Returns
        -------
        Run
        """
        periods, rtol = check_count("periods", periods), check_rtol(rtol)
        m, recorder = self.fixed.map, self.fixed.map.recorder
        phase = (self.parameters["phi0"] - m.phase) % TURN
        state, _ = m.sampled(self.slow_motion.passage, phase)
        # a run begins at the origin, whatever place, heading and spinning angle the passage has come to
        begun = State(*state)._replace(phase=0.0, period=0.0, theta=0.0, x1=0.0, y1=0.0, gamma=0.0)
        row = m.row_at(self.parameters["phi0"])
        solved = run_row(row, np.array([[*begun, 0.0, 0.0]]), exactly(periods, rtol), recorder.space, record=record)
        run = as_run(self.parameters, rtol, solved, None)
        if not record:
            return run
        start = start_of(run.states(0.0))
        del start["phase"]  # the parameter phi0 has it
        return replace(run, start=start)

    def plot(self, path: str | PathLike[str] | None = None, *, force: bool = False, **look: "Unpack[Look]") -> "Figure":
        """Plot heights, path and phase portraits of a run that starts on the orbit, as `Run.plot` does.

        Raises
        ------
        ParameterError, StoreError
            If the picture cannot be written.
        """
        told = f"{'stable' if self.stable else 'unstable'} orbit of spin {self.spin:.6g} rad/s"
        heading = f"{told}: {conditions(self.parameters, START, tex=True)}"
        return self.run(SHOWN_PERIODS * self.periods).plot(path, force=force, **{"title": heading} | look)


def circle_of(radius: float) -> str:
    """Return a radius [m] in words: "in a plane" for NaN."""
    return "in a plane" if np.isnan(radius) else f"radius {radius:.6g} m"


def orbit_of(fixed: Solution, slow_motion: SlowMotion | None = None) -> PeriodicOrbit:
    """Return the orbit with the multipliers of a fixed point and the numbers of the slow motion beside it.

    Without a slow motion, the numbers are those of the fixed point, too.
    """
    m = fixed.map
    if slow_motion is None:
        slow_motion = slow_motion_at(fixed)
    parameters, passage = m.parameters, slow_motion.passage
    read = passage.read
    turn = slow_motion.turn / m.periods
    in_plane = abs(turn) <= CIRCLE or abs(passage.spin) <= PLANE * m.unit
    rate = 0.0 if in_plane else turn * parameters["f"]
    fast, slow = multipliers_of(fixed)
    return PeriodicOrbit(
        parameters=dict(parameters),
        periods=m.periods,
        spin=passage.spin,
        radius=read.speed / abs(rate) if rate else float("nan"),
        period=TURN / abs(rate) if rate else float("nan"),
        precession_rate=rate,
        impact_phase=(m.phase + read.phase) / TURN % 1.0,
        speed=read.speed,
        zeta=read.zeta,
        di_end=DI_ENDS[int(read.di_end)],
        spin_drift=slow_motion.drift / m.periods + 0.0,
        precession_rate_drift=slow_motion.turn_drift * parameters["f"] / m.periods**2,
        multipliers=fast if fast.size else np.zeros(1, dtype=complex),
        slow_multiplier=slow,
        stable=bool((np.abs(fast) < 1).all()),
        residual=fixed.residual,
        sequence=passage.sequence,
        cost=m.recorder.periods,
        rtol=m.rtol,
        fixed=fixed,
        slow_motion=slow_motion,
    )


# --- orbits as labelled data -----------------------------------------------------------------------------------------

MOST_MULTIPLIERS = len(NAMES) - 1  # multipliers of a fast part in the air; contact makes some of them zero
COLUMNS = {
    "spin": QUANTITIES["spin"],
    **{name: QUANTITIES[name] for name in (*ORBIT_NAMES, "path_radius", "path_speed")},
    "spin_drift": Quantity("rad s-1", "change per forcing period: axial spin after the double impact"),
    "slow_multiplier": Quantity("1", "multiplier of the direction along the family"),
    "residual": Quantity("1", "how far the fast part fails to close, in units of the section"),
    "cost": Quantity("1", "forcing periods of the map spent up to here"),
}
TEXTS = {
    "stable": Quantity("1", "whether all multipliers of the fast part are below 1 in size"),
    "periods": Quantity("1", "forcing periods after which the motion repeats"),
    "di_end": QUANTITIES["di_end"],
    "word": Quantity("1", "symbol sequence: contact states and impacts of a period, in their order"),
}
# attributes of an orbit whose columns have other names, since files that were written before have these names
ATTRIBUTE_OF = {"word": "sequence"}
DOUBLING = Quantity("1", "coefficient of the flip: a stable orbit of twice the period begins where it is positive")
MULTIPLIERS = {
    "multipliers_real": Quantity("1", "real parts of the multipliers of the fast part, the largest first"),
    "multipliers_imag": Quantity("1", "imaginary parts of the multipliers of the fast part"),
}


def padded(values: np.ndarray) -> np.ndarray:
    """Return multipliers, shape (MOST_MULTIPLIERS,), with zeros for the directions that contact takes away."""
    row = np.zeros(MOST_MULTIPLIERS, dtype=complex)
    row[: values.size] = values
    return row


def multiplier_columns(multipliers: Iterable[np.ndarray]) -> tuple[Column, ...]:
    """Return the columns of the multipliers of each row, real and imaginary parts: NetCDF knows no complex numbers."""
    rows = np.array([padded(each) for each in multipliers]).reshape(-1, MOST_MULTIPLIERS)
    parts = zip(MULTIPLIERS.items(), (rows.real, rows.imag), strict=True)
    return tuple(Column(name, quantity, part, along="multiplier") for (name, quantity), part in parts)


def dataset(orbits: Sequence[PeriodicOrbit], dim: str, more: Iterable[Column] = ()) -> xr.Dataset:
    """Return the table of orbits along `dim`, with `more` columns; parameters that all share are scalar coordinates."""
    numbers = (Column(name, said, [float(getattr(orbit, name)) for orbit in orbits]) for name, said in COLUMNS.items())
    texts = (
        Column(name, said, attrgetter(ATTRIBUTE_OF.get(name, name)), CODE_WORDS.get(name, ()))
        for name, said in TEXTS.items()
    )
    multipliers = multiplier_columns(orbit.multipliers for orbit in orbits)
    made = table(orbits, (*numbers, *texts, *more, *multipliers), dim)
    shared = dict(orbits[0].parameters) if orbits else {}
    for orbit in orbits:
        shared = {name: value for name, value in shared.items() if orbit.parameters.get(name) == value}
    return made.assign_coords(fixed_coordinates({name: shared[name] for name in shared if name not in made}))
