"""Hold one simulation: its outcome, with its events and its state at any time if it was recorded."""

import warnings
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import isnan
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import OF_A_RUN, finished
from dimersweep.cubes.seen_run import check_shown, meanings
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_numbers, check_count
from dimersweep.kernel.batch import Workspace
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    CODE_STATUS,
    CODE_WORDS,
    CODES,
    DOWN_WORDS,
    ORBIT_COLUMNS,
    OUT,
    PERIOD,
    RUN_COLUMNS,
    STATUS_MESSAGES,
    RunNumbers,
)
from dimersweep.parameters import Parameters
from dimersweep.runs.outcomes import MissingValue, Orbit, no_orbit
from dimersweep.runs.recorded import RunRecord, events_of, made_with, named_state, states_of
from dimersweep.runs.solving import RunEnd, RunSettings, Solved, check_recorded, exactly, go_on, run_row
from dimersweep.runs.starting import fitted, kernel_start
from dimersweep.symbols import CAPTION, START, conditions
from dimersweep.work.proving import is_proven, prove
from dimersweep.work.stopping import stoppable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dimersweep.plots.style import Look
    from dimersweep.plots.view import View
    from dimersweep.runs.energy import By
    from dimersweep.runs.sections import At

LIES_STILL = 1e-9  # speed [m/s] below which the words of a run say that the dimer lies still


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Run(RunNumbers):
    """Result of one simulation; its numbers, and those of its orbit, are columns of every cube, too.

    Attributes
    ----------
    status, message : str
        "ok", or a word for the reason why the run stopped early; that reason as a sentence.
    mode : str
        Mode of the motion at the end: rest, rolls, slides, drift, jump, flutter, period_n, aperiodic, unresolved or, if
        the status is not "ok", failed.
    mode_period : int
        Forcing periods after which the motion repeats, 0 if it does not.
    track : str
        Track of a settled motion on the plate: straight, arc, circle, loops, waves, cusps or reversals
        (docs/imperfect.md); none if it has not settled, or both ends stay down.
    parameters : dict
        Every parameter of the model; those that may be left out (`symbols.LEFT_OUT`) only if they were given.
    start : dict or None
        State from which the run started, by the names of `states`; its phase is `phi0`. None if parameters such as
        `beta0` and `xdot0` give the start.
    rtol : float
        Accuracy [1].
    n_events : int
        Number of landings, of the impacts that they lead to, of lift-offs, and of changes between slip and stick. The
        table `events` has other rows: none for a landing, one for each contact state of an impact, and rows of the
        causes "chatter_end" and "end".
    n_periods : int
        Completed forcing periods.
    orbit : Orbit or Absent
        Orbit of a drift. In other modes it is false, and each of its attributes raises an error that names the mode.
    down_share_1, down_share_2 : float
        Share of the last 12 periods in which each end is down [1]: closed, or in hops shorter than half a period. Only
        whole periods of the motion count, at least one: the last 10 where it repeats after 5, 14 where it repeats after
        14. A hop that goes on at the end counts as the hop one period of the motion before. Of a longer flight the part
        within those periods counts.
    settled_after : float
        Forcing periods until the motion had settled; NaN if it has not.
    spin_drift : float
        Change of the axial spin per forcing period [rad s-1], the slow drift along the family of orbits that the motion
        passes; NaN if the motion has not settled. For a drift, the spin after the double impact is fitted over the last
        20 periods. For other modes it is the spin at the ends of the last 24 periods, in whole periods of the motion.
    longest_hop_1, longest_hop_2 : float
        Longest time that each end is off the plate without a break [forcing periods]. Hops count that ended in the
        periods of `down_share_1`, or go on at the end. From 0.5 on a ball counts as flying.
    change_ahead : float
        Largest change that the numbers of a run would still make in the periods that were asked for and not run,
        extrapolated; 0 of a run that made them all, or rests. It is relative for the orbit's radius, period, speed and
        precession rate, for the spin of any motion, and for an angle above 1 rad by which the heading turns. It is
        absolute for zeta [rad], impact phase [cycles] and the longest hops [forcing periods].
    centre_velocity_x, centre_velocity_y : float
        Velocity of the circle's centre relative to the plate [m/s]: the displacement over the last whole turn, from a
        heading to the same heading, over its time. It is 0 on a level plate. It is NaN if no whole turn was made since
        the motion settled, or since its heading turned back.

    Examples
    --------
    >>> from dimersweep import simulate
    >>> run = simulate(periods=60)
    >>> run
    <Run: ok, drift, radius 4.245 m, zeta 1.604 rad, 60 periods, 902 events>
    >>> run.states([0.0, 1.0])["gap_2"].attrs["units"]
    'm'
    """

    status: str
    message: str
    mode: str
    mode_period: int
    track: str
    parameters: dict[str, float]
    rtol: float
    n_events: int
    n_periods: int
    orbit: Orbit | MissingValue
    start: dict[str, float] | None = None
    _record: RunRecord | None = field(default=None)
    _end: RunEnd | None = field(default=None)

    def __repr__(self) -> str:
        circle = f"radius {self.orbit.radius:.4g} m" if self.orbit and not isnan(self.orbit.radius) else "straight"
        orbit = f", {circle}, zeta {self.orbit.zeta:.4g} rad" if self.orbit else ""
        moves = f"moves at {self.end_speed:.3g} m/s" if self.end_speed > LIES_STILL else "lies still"
        rest = f", both ends down, {moves}" if self.mode in DOWN_WORDS else ""
        kept = f", {'record cut' if self._record else self.record_cut}" if self.record_cut else ""
        return f"<Run: {self.status}, {self.mode}{orbit}{rest}, {self.n_periods} periods, {self.n_events} events{kept}>"

    def __str__(self) -> str:
        return "\n".join([repr(self), *(f"{word}: {meaning}" for word, meaning in meanings(self).items())])

    def _repr_html_(self) -> str:
        from dimersweep.plots.tables import run_table

        return run_table(self)

    @property
    def duration(self) -> float:
        """Time that was simulated [s].

        Examples
        --------
        >>> from dimersweep import simulate
        >>> simulate(f=15, periods=60).duration
        4.0
        """
        return self.n_periods / self.parameters["f"]

    @property
    def end_speed(self) -> float:
        """Speed of the centre of mass over the floor at the end [m/s].

        A dimer whose ends stay down may roll or slide on.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> run = simulate(beta0="10 deg", periods=60)
        >>> run.mode, round(run.end_speed, 3)
        ('rest', 0.725)
        """
        return float("nan") if self._end is None else float(np.hypot(*self._end.start[0, [CA, CB]]))

    def conditions(self, always: Collection[str] = CAPTION, *, tex: bool = False) -> str:
        """Return the parameters of this run in words.

        These are the parameters in the paper's captions, and all others that differ from the base case.

        Parameters
        ----------
        always : collection of str
            Parameters that are named in any case.
        tex : bool
            True for symbols in TeX, False for plain letters.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> run = simulate(e=0.5, f="20 Hz", periods=60)
        >>> print(*run.conditions(always=()).split())  # its spaces do not break
        e = 0.5, f = 20 Hz
        """
        if self.start is None:
            return conditions(self.parameters, always=always, tex=tex)
        words = conditions(self.parameters, START, always, tex=tex)
        return f"{words}, from a given state".removeprefix(", ")

    def record(self, wanted: str) -> RunRecord:
        """Return the kernel's record of this run; `wanted` names the result that needs it, for the error.

        Raises
        ------
        ParameterError
            If nothing was recorded.
        """
        if self._record is None:
            raise ParameterError(f"{wanted}: nothing was recorded; run simulate with record=True")
        return self._record

    @property
    def record_cut(self) -> str:
        """Words for what the record lacks: the whole run, or its end; "" if it lacks nothing.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> simulate(periods=60).record_cut
        ''
        """
        if self._record is None:
            return "not recorded"
        if not self._record.cut:
            return ""
        periods = int(self._record.segments[-1, PERIOD])
        return f"events and states end after {periods} of {self.n_periods} forcing periods"

    @cached_property
    def events(self) -> xr.Dataset:
        """Events of the run, along `event`, in order of time.

        An impact has one row for each of its contact states, all at the same time, each with its own share of the
        impulses. The velocity of a contact point that takes no part in an impact is NaN. A chatter ends where its
        bounces accumulate, or at the next event if that comes before.

        A slip that ends where friction cannot hold the end goes on in another direction: its cause is slip, and not
        stick. Kinds, causes and contact states are flags, see `names`.

        Raises
        ------
        ParameterError
            If nothing was recorded.

        Examples
        --------
        >>> from dimersweep import names, simulate
        >>> events = names(simulate(periods=60).events)
        >>> impacts = events.sel(event=events["cause"] == "impact")
        >>> impacts["kind"].values[-3:].tolist()
        ['SI1_sk', 'SI1_sp', 'SI1_sk']
        """
        record = self.record("events")
        events = events_of(record)
        return events.assign_attrs(comment=f"cut: {self.record_cut}") if record.cut else events

    def states(self, t: Any) -> xr.Dataset:
        """Return the states at any times.

        Each is moved from the event before it in closed form, or integrated to `rtol`. At the time of an event it is
        the state right after the event; so it is at t = 0, where the plate hits p1.

        Parameters
        ----------
        t : float or array_like, shape (n,)
            Times since the start [s], in any order.

        Returns
        -------
        xarray.Dataset
            Quantities along `time`; scalars for one time.

        Raises
        ------
        ParameterError
            If nothing was recorded, or a time is no number or outside the run. Also if the phase of contact before a
            time is so long that it takes more steps than allowed.

        Examples
        --------
        >>> import numpy as np
        >>> from dimersweep import simulate
        >>> run = simulate(periods=60)
        >>> run.states(1.0)["beta"].item()  # [rad]
        0.0414
        >>> run.states(np.linspace(0, run.duration, 200)).sizes["time"]
        200
        """
        record = self.record("states")
        if not len(record.segments):
            raise ParameterError(
                f"states: there are none, the run ended before its first smooth phase ({self.message})"
            )
        times = as_numbers("t", t, "s")
        states = states_of(record, times).assign_coords(made_with=made_with(self.parameters))
        states = finished(states, f"States {OF_A_RUN}")
        return states if np.ndim(t) else states.isel(time=0)

    def energy(self, by: "By" = "period") -> xr.Dataset:
        """Return the energy budget: the work of the plate, and the losses to restitution and slip, at each end.

        The plate gives energy by its normal force and, where it moves along itself, by friction. All terms are works on
        the dimer: a loss is negative. `energy` follows from the states alone. The works follow from the forces and the
        law of impact (Eqs. 4, 6, 7) and are integrated along with the run, which is made once more for them.

        `residual` is the change of `energy` less the sum of the works, and the attribute `closure` says how large it
        becomes. The budget begins right after the impact at the start.

        Parameters
        ----------
        by : {"period", "event"}
            Sum the works over each forcing period, along `n`; or give them for each smooth phase and for each contact
            state of an impact, along `part`.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        ParameterError
            If nothing was recorded, or `by` is another word.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> budget = simulate(periods=60).energy().isel(n=slice(-12, None)).mean("n")
        >>> print(f"{1e6 * budget.plate_2:.1f} uJ from the plate at p2, {1e6 * budget.restitution_2:.1f} uJ to restitution")
        233.4 uJ from the plate at p2, -230.5 uJ to restitution
        """
        from dimersweep.runs.energy import energy_of

        record = self.record("energy")
        if len(record.segments) < 2:
            raise ParameterError(f"energy: there is none, the run ended before its first smooth phase ({self.message})")
        return stoppable(partial(energy_of, record, by))

    def section(self, at: "At" = "period", *, phase: float | str | None = None) -> xr.Dataset:
        """Return states as points of a map: of the return map, at impacts, or at a phase of the plate.

        Parameters
        ----------
        at : {"period", "double_impact", "landing_1", "landing_2"}
            The start of each forcing period and the end of the last; right after each impact that begins with both ends
            on the plate; right after each landing of p1 or p2. Bounces of a chatter are landings, too, but for those
            that the run sums.
        phase : float or str, optional
            Phase of the plate, omega t + phi0 [rad], in place of the start of a period.

        Returns
        -------
        xarray.Dataset
            Quantities as in `states`, along `n`: the number of forcing periods since the start, or the number of the
            impact. At impacts also the rates of the gaps before them.

        Raises
        ------
        ParameterError
            If nothing was recorded, `at` is another word, or a phase is given with an impact.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> points = simulate(periods=60).section(at="double_impact")
        >>> print(f"phase {points.phase.values[-1]:.4f} rad, {points.gap_2_rate_before.values[-1]:.4f} m/s")
        phase 0.5083 rad, -0.4041 m/s
        """
        from dimersweep.runs.sections import section_of

        return section_of(self, at, phase)

    def go_on(self, periods: int) -> "Run":
        """Return this run made longer by `periods` forcing periods.

        The new part starts from the state at the end of the last period, and the result has the whole run. A run of n
        and then m periods is a run of n + m periods: all of 250 random runs were equal bit for bit. Where a contact at
        that moment is undecided to the accuracy, the last digits may differ within `rtol`.

        Parameters
        ----------
        periods : int

        Returns
        -------
        Run
            It is recorded if this run is.

        Raises
        ------
        ParameterError
            If this run did not reach its end, or would become too long to be recorded.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> run = simulate(periods=60)
        >>> run.go_on(140)
        <Run: ok, drift, radius 4.245 m, zeta 1.604 rad, 200 periods, 3002 events>
        """
        total = self.n_periods + check_count("periods", periods)
        if self.status != "ok" or self._end is None:
            raise ParameterError(f"go_on: the run did not reach its end ({self.message})")
        if self._record is not None:
            check_recorded(total)
        row, how = Parameters(**self.parameters).row(), exactly(total, self.rtol)
        solved = stoppable(partial(go_on, row, self._end, self.n_events, self._record, how))
        return as_run(self.parameters, self.rtol, solved, self.start)

    def save(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the run to one NetCDF file, from which `load_run` reads it back exactly.

        Parameters
        ----------
        path : path-like
        force : bool
            True if an existing file may be replaced.

        Raises
        ------
        ParameterError
            If `path` does not end in .nc.
        StoreError
            If the file cannot be written.

        Examples
        --------
        >>> from dimersweep import load_run, simulate
        >>> path = simulate(periods=60).save("run.nc", force=True)
        >>> load_run(path).mode
        'drift'
        """
        from dimersweep.runs.saving import write_run

        return write_run(vars(self), self.events if self._record else xr.Dataset(), path, force=force)

    def plot(self, path: str | PathLike[str] | None = None, *, force: bool = False, **look: "Unpack[Look]") -> "Figure":
        """Draw heights, orbit and phase portraits, and write the picture to `path` if given; `look` as in `plots.Look`.

        Raises
        ------
        ParameterError, StoreError
            If nothing was recorded, the run ended before a forcing period, or the picture cannot be written.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> figure = simulate(periods=60).plot("run.png", force=True)
        >>> figure.get_size_inches()
        array([11.,  7.])
        """
        from dimersweep.plots import check_picture, run_figure, write_picture

        check_shown(self, "plot")
        if path is not None:
            check_picture(path, force=force, name="picture")
        figure = run_figure(self, **look)
        if path is not None:
            write_picture(figure, path, force=force)
        return figure

    def animate(
        self,
        path: str | PathLike[str],
        *,
        periods: int = 6,
        speed: float = 0.1,
        fps: int = 25,
        slow_impacts: bool = False,
        last: bool = True,
        dpi: int = 80,
        force: bool = False,
    ) -> Path:
        """Write a movie: the dimer on its plate from the side and from above, with the track of its centre of mass.

        Parameters
        ----------
        path : path-like
            File that ends in .gif, in .mp4 (needs ffmpeg), or in .html: one page that plays in a browser without a
            network.
        periods : int
            Forcing periods to show; all, if the run has fewer.
        speed : float
            Seconds of the run in one second of the movie [1].
        fps : int
            Frames in one second of the movie. A GIF has at most 50. In a page the browser leaves out frames if it is
            slow.
        slow_impacts : bool
            True to run 20 times slower around double impacts.
        last : bool
            True to show the end of the run, False for its start.
        dpi : int
            Dots per inch of a GIF or video of 7.2 by 3.7 inches; 600 at most.
        force : bool
            True if an existing file may be replaced.

        Returns
        -------
        Path

        Raises
        ------
        ParameterError
            If nothing was recorded, the run ended before a forcing period, or the movie would be too long.
        StoreError
            If the file cannot be written, or a program that it needs is not installed.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> simulate(periods=60).animate("drift.gif", periods=2, fps=10, force=True).name
        'drift.gif'
        """
        from dimersweep.plots.movie import write_movie
        from dimersweep.plots.playback import playback_of

        playback = playback_of(self, periods, speed, fps, last=last, slow_impacts=slow_impacts)
        return write_movie(self, path, playback, dpi, force=force)

    def view(self, *, periods: int = 6, last: bool = True) -> "View":
        """Show the run in motion, in a notebook: the dimer on its plate, its heights, its track and its numbers.

        The result is the page of `dimersweep explore` without its sliders. It needs no server and no network.

        Parameters
        ----------
        periods : int
            Forcing periods to show; all, if the run has fewer.
        last : bool
            True to show the end of the run, False for its start.

        Returns
        -------
        View
            Object that a notebook shows as the page; `html` is the text of the page.

        Raises
        ------
        ParameterError
            If nothing was recorded, or the run ended before a forcing period.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> page = simulate(periods=60).view(periods=2).html
        >>> page.startswith("<!DOCTYPE html>")
        True
        """
        from dimersweep.plots.view import USUAL_SPEED, View, page_of, stretch_of

        return View(page_of(self, stretch_of(self, periods, last=last), USUAL_SPEED))

    def error(self, t: Any = None) -> xr.Dataset:
        """Estimate bounds on the errors of this run, with two more runs that shadow it (docs/trust.md).

        Parameters
        ----------
        t : float or array_like, shape (n,), optional
            Times since the start [s]; the ends of all forcing periods are added.

        Returns
        -------
        xarray.Dataset
            Along `time`: for each quantity of `states`, a bound on its error up to that time, in the unit of the
            quantity; and `scaled`, the largest bound of the coordinates and their rates. Its units are 1 cm, 0.1 m/s,
            1 rad and 1 rad/s, for gamma 10 rad and 100 rad/s.

            Along `event`: a bound on the error of the time of the event [s], NaN for an event that a shadow lacks.

            `slip_undecided` is the time [s] of the first double impact in which a slip passes zero and `rtol` decides
            whether `mu_s` holds it; NaN if there is none.

        Raises
        ------
        ParameterError
            If nothing was recorded, the run did not reach its end, or a time is no number or outside the run.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> run = simulate(periods=60)
        >>> bounds = run.error()
        >>> bounds["x"].sel(time=run.duration).item() < 1e-6  # [m]
        True
        """
        from dimersweep.runs.shadows import bounds, shadow_starts

        self.record("error")
        if self.status != "ok":
            raise ParameterError(f"error: the run did not reach its end ({self.message})")
        if self.record_cut:
            raise ParameterError(f"error: needs the whole record, but {self.record_cut}")
        times = np.arange(self.n_periods + 1) / self.parameters["f"]
        times = np.union1d(times, [] if t is None else self.states(t)["time"])
        rtol, starts = shadow_starts(self.rtol, self.parameters, self.start)
        how = exactly(self.n_periods, rtol)

        def call(space: Workspace) -> list[Run]:
            return [simulate_checked(Parameters(**given), how, space, begun=begun) for given, begun in starts]

        return bounds(self, stoppable(call), times, 1 / self.parameters["f"])


def as_run(parameters: dict[str, float], rtol: float, solved: Solved, start: dict[str, float] | None) -> Run:
    """Return the run that the kernel's results describe."""
    code = dict(zip(CODES, solved.codes.tolist(), strict=True))
    code |= {name: words[code[name]] for name, words in CODE_WORDS.items()}
    out = dict(zip(OUT, solved.out.tolist(), strict=True))
    di_end, of_orbit = code.pop("di_end"), (*ORBIT_COLUMNS, "spin_drift")
    return Run(
        message=STATUS_MESSAGES[solved.codes[CODE_STATUS]],
        parameters=parameters,
        start=start,
        rtol=rtol,
        orbit=Orbit(di_end=di_end, **{name: out[name] for name in of_orbit})
        if code["mode"] == "drift"
        else no_orbit(code["mode"]),
        **code,
        **{name: out[name] for name in RUN_COLUMNS},
        _record=solved.record,
        _end=solved.end,
    )


def simulate_checked(
    parameters: Parameters,
    how: RunSettings,
    space: Workspace,
    *,
    record: bool = True,
    begun: dict[str, float] | None = None,
    before: Parameters | None = None,
) -> Run:
    """Make the run of `simulate` from checked input, on scratch arrays through which it may be stopped.

    `begun` is the state to start from, by its names, of a dimer of the parameters `before`, if there are any. It is
    fitted to the shape that `parameters` give.
    """
    row, first = parameters.row(), None
    if begun is not None:
        begun = {name: value for name, value in begun.items() if name != "phase"}  # the phase is in phi0 by now
        shaped = parameters if before is None else replace(before, phi0=parameters.phi0)
        unfitted = kernel_start(begun, shaped.given())
        first = fitted(unfitted, shaped.row(), row)
        begun = begun if first is unfitted else named_state(row, first)
    solved = run_row(row, first, how, space, record=record)
    return as_run(parameters.given(), how.rtol, solved, begun)


def proven_run(call: Callable[[Workspace], Run], seconds: float | None = None) -> Run:
    """Prove the kernel, and return the run that `call` makes on scratch arrays within `seconds`; see `stoppable`."""
    if not is_proven():
        stoppable(lambda _: prove())  # apart, as compilation is no part of the run's time
    run = stoppable(call, seconds)
    if run._record and run.record_cut:
        warnings.warn(f"record: is full; {run.record_cut}", RuntimeWarning, stacklevel=3)
    return run


def load_run(path: str | PathLike[str]) -> Run:
    """Read a run that `Run.save` wrote.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Run
        The run, with the same events and states, bit for bit, on the machine and with the version that wrote it.

    Raises
    ------
    StoreError
        If there is no such file, or it is no run, or is damaged.

    Examples
    --------
    >>> from dimersweep import load_run, simulate
    >>> path = simulate(periods=60).save("walk.nc", force=True)
    >>> load_run(path).mode
    'drift'
    """
    from dimersweep.runs.saving import read_run

    return Run(**read_run(path))
