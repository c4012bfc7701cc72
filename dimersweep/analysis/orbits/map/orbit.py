"""An orbit: the fixed point of the fast part at a given spin, and all that follows from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.map.manifold import SlowMotion, multipliers_of, slow_motion_at
from dimersweep.analysis.orbits.map.newton import Fixed
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.analysis.orbits.map.poincare import ReturnMap
from dimersweep.cubes.cube import column, fixed_coordinates
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

SHOWN_PERIODS = 12  # of an orbit in its picture: one that is unstable has not left it yet
CIRCLE = 1e-12  # turn of a period [rad] that is none
PLANE = 1e-10  # spin that is none, in units of the section: a sustained spin of 0 is located so well
CHORDS = 16  # parts of a forcing period: with these the radius of the base case's path is known to 1e-6 m


class MeanPath(NamedTuple):
    """The circle about which the centre of mass swings.

    Attributes
    ----------
    radius, speed : float
        inf for a straight path [m]; along the circle or the line [m s-1].
    bend : complex
        Change of the mean velocity over itself, seen from the heading (real part: it grows; imaginary part: it turns in the
        sense of the path) [s-1].
    phases : ndarray, shape (n,)
        Of the plate, in each forcing period the same [rad].
    swing : ndarray of complex, shape (n,)
        There, how far the centre of mass is out of the circle (real part), and ahead on it (imaginary part) [1]: in radii.
    """

    radius: float
    speed: float
    bend: complex
    phases: np.ndarray
    swing: np.ndarray


def path_of(m: ReturnMap, z: np.ndarray) -> MeanPath:
    """The mean path of a motion over its period from a point of the section on.

    The chords of the parts of the period are summed as in `kernel.mean_path`; those of the next one give the bend.
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
        Of the model.
    periods : int
        Forcing periods after which it repeats.
    spin : float
        Axial spin after the double impact (without one: after the last impact of the end that is in the air for longer)
        [rad s-1], as that of `Run.orbit`. For period n, of the last one.
    radius : float
        Equivalent radius (11), `speed` over precession rate; NaN for a motion in a plane [m].
    path_radius, path_speed : float
        Radius of the mean path of the centre of mass, as a camera sees it, NaN in a plane [m]; speed along it [m s-1].
    period : float
        Time once round [s], for either radius; NaN in a plane.
    zeta, speed : float
        Angle from the axis to the velocity [rad], speed of the centre of mass [m s-1], there too.
    precession_rate : float
        Mean rate of theta [rad s-1].
    impact_phase : float
        Phase of that impact in cycles of the plate, in [0, 1) [1].
    di_end : str
        Friction after it, of the end that is down and of the one that bounces; none if it is no double impact.
    spin_drift, precession_rate_drift : float
        Change of the spin and of the precession rate per forcing period along the slow family [rad s-1].
    multipliers : ndarray of complex
        Of the fast part, over the period of the motion, the largest first [1]; a single 0 if nothing but the spin is
        remembered.
    slow_multiplier : float
        That of the direction along the family [1].
    stable : bool
        Whether all multipliers of the fast part are below 1 in size.
    residual : float
        How far the motion fails to close, but for the slow drift along the family, in units of the section.
    sequence : str
        The symbol sequence: what contact states and impacts follow one another in a period (docs/orbits.md).
    cost : float
        Forcing periods of the map that it took.
    others : tuple of PeriodicOrbit
        Unstable ones of the same spin that were found before it, by `orbits.find`.

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
    fixed: Fixed = field(repr=False)
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
        """The mean path of the centre of mass."""
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
        """A run that starts on the orbit, at the plate's phase `phi0` of the parameters.

        Parameters
        ----------
        periods : int
        rtol : float
            Accuracy of the run [1].
        record : bool
            Whether it is recorded.

        Returns
        -------
        Run
        """
        periods, rtol = check_count("periods", periods), check_rtol(rtol)
        m, recorder = self.fixed.map, self.fixed.map.recorder
        phase = (self.parameters["phi0"] - m.phase) % TURN
        state, _ = m.sampled(self.slow_motion.image.passage, phase)
        # the cyclic coordinates begin anew
        begun = State(*state)._replace(phase=0.0, period=0.0, theta=0.0, x1=0.0, y1=0.0, gamma=0.0)
        row = m.row_at(self.parameters["phi0"])
        solved = run_row(row, np.array([[*begun, 0.0, 0.0]]), exactly(periods, rtol), recorder.space, record=record)
        run = as_run(self.parameters, rtol, solved, None)
        if not record:
            return run
        start = start_of(run.states(0.0))
        del start["phase"]  # which is phi0
        return replace(run, start=start)

    def plot(self, path: str | PathLike[str] | None = None, *, force: bool = False, **look: "Unpack[Look]") -> "Figure":
        """Heights, path and phase portraits of a run that starts on the orbit, as by `Run.plot`.

        Raises
        ------
        ParameterError, StoreError
            If the picture cannot be written.
        """
        told = f"{'stable' if self.stable else 'unstable'} orbit of spin {self.spin:.6g} rad/s"
        heading = f"{told}: {conditions(self.parameters, START, tex=True)}"
        return self.run(SHOWN_PERIODS * self.periods).plot(path, force=force, **{"title": heading} | look)


def circle_of(radius: float) -> str:
    """Return a radius in words; there is none in a plane."""
    return "in a plane" if np.isnan(radius) else f"radius {radius:.6g} m"


def orbit_of(fixed: Fixed, slow_motion: SlowMotion | None = None) -> PeriodicOrbit:
    """The orbit of a fixed point, and of the motion that drifts slowly along the family beside it.

    Without such a motion all is that of the fixed point. The multipliers are those of the derivatives of `fixed`.
    """
    m = fixed.map
    if slow_motion is None:
        slow_motion = slow_motion_at(fixed)
    parameters, image = m.parameters, slow_motion.image
    read = image.passage.read
    turn = slow_motion.turn / m.periods
    in_plane = abs(turn) <= CIRCLE or abs(image.spin) <= PLANE * m.unit
    rate = 0.0 if in_plane else turn * parameters["f"]
    fast, slow = multipliers_of(fixed)
    return PeriodicOrbit(
        parameters=dict(parameters),
        periods=m.periods,
        spin=image.spin,
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
        sequence=image.passage.sequence,
        cost=m.recorder.periods,
        rtol=m.rtol,
        fixed=fixed,
        slow_motion=slow_motion,
    )


# --- orbits as labelled data -----------------------------------------------------------------------------------------

Column = tuple[Any, ...]  # entries, one an orbit or a row of numbers; what they are; and, of a flag, its words

MOST_MULTIPLIERS = len(NAMES) - 1  # multipliers of a fast part at most; those that contact takes away are zero
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
ATTRIBUTE_OF = {"word": "sequence"}  # attributes of an orbit whose columns have other names, those of former files
DOUBLING = Quantity("1", "coefficient of the flip: a stable orbit of twice the period begins where it is positive")
MULTIPLIERS = {
    "multipliers_real": Quantity("1", "real parts of the multipliers of the fast part, the largest first"),
    "multipliers_imag": Quantity("1", "imaginary parts of the multipliers of the fast part"),
}


def padded(values: np.ndarray) -> np.ndarray:
    """Multipliers, shape (MOST_MULTIPLIERS,), with zeros for the directions that contact takes away."""
    row = np.zeros(MOST_MULTIPLIERS, dtype=complex)
    row[: values.size] = values
    return row


def multiplier_columns(dims: Sequence[str], rows: np.ndarray) -> dict[str, xr.Variable]:
    """Multipliers as a table has them: NetCDF knows no complex numbers."""
    parts = zip(MULTIPLIERS.items(), (rows.real, rows.imag), strict=True)
    return {name: xr.Variable(dims, part, quantity.attributes()) for (name, quantity), part in parts}


def dataset(orbits: Sequence[PeriodicOrbit], dim: str, more: Mapping[str, Column] = {}) -> xr.Dataset:
    """The attributes of orbits along `dim`, and `more` columns; parameters that all share are scalar coordinates."""
    columns: dict[str, Column] = {
        name: ([getattr(orbit, ATTRIBUTE_OF.get(name, name)) for orbit in orbits], said, CODE_WORDS.get(name, ()))
        for name, said in (COLUMNS | TEXTS).items()
    }
    made = {}
    for name, (entries, *said) in (columns | dict(more)).items():
        values = np.array(entries, dtype=float if name in COLUMNS else None)
        made[name] = column((dim, "number")[: values.ndim], values, *said)
    rows = np.array([padded(orbit.multipliers) for orbit in orbits]).reshape(-1, MOST_MULTIPLIERS)
    table = xr.Dataset(made | multiplier_columns((dim, "multiplier"), rows))
    shared = dict(orbits[0].parameters) if orbits else {}
    for orbit in orbits:
        shared = {name: value for name, value in shared.items() if orbit.parameters.get(name) == value}
    return table.assign_coords(fixed_coordinates({name: shared[name] for name in shared if name not in table}))
