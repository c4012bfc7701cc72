"""One simulation that was made: its outcome, with its events and its state at any time where it was recorded."""

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
from dimersweep.runs.outcomes import Absent, Orbit, no_orbit
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

LIES_STILL = 1e-9  # speed [m/s] below which a dimer is said to lie still


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Run(RunNumbers):
    """One simulation; its numbers, and those of its orbit, are columns of every cube, too.

    Attributes
    ----------
    status, message : str
        "ok", or the name of the reason why the run stopped early; that reason in words.
    mode : str
        What the motion became: rest, rolls, slides, drift, jump, flutter, period_n, aperiodic, unresolved or, without "ok",
        failed.
    mode_period : int
        Forcing periods after which it repeats, 0 if it does not.
    track : str
        What a settled motion draws on the plate: straight, arc, circle, loops, waves, cusps or reversals
        (docs/imperfect.md); none if it has not settled, or both ends stay down.
    parameters : dict
        Every parameter of the model; those that may be left out (`symbols.LEFT_OUT`) where they were not.
    start : dict or None
        The state that it started from, by the names of `states`, its phase being `phi0`; None where parameters give the
        start, such as `beta0` and `xdot0`.
    rtol : float
        Accuracy [1].
    n_events : int
        Landings, the impacts that they lead to, lift-offs, and changes between slip and stick. The table `events` has other
        rows: none for a landing, one for each contact state of an impact, and those of its cause "chatter_end" and "end".
    n_periods : int
        Completed forcing periods.
    orbit : Orbit or Absent
        Of a drift. Of other modes it is false, and whatever is asked of it says in a line which mode there is.
    down_share_1, down_share_2 : float
        Share of the last 12 periods (or the multiple of the motion's period below, at least one) that each end is down [1]:
        closed, or in hops shorter than half a period. A hop that goes on at the end is as long as that one period of the motion
        before; of a longer flight what lies within those periods counts.
    settled_after : float
        Forcing periods until the motion had settled; NaN if it has not.
    spin_drift : float
        Change of the axial spin per forcing period: the slow drift along the family of orbits that the motion goes through
        [rad s-1]; NaN if it has not settled. Of a drift it is that after the double impact, fitted over the last 20 periods;
        else that at the ends of the periods, over the last 24 or the multiple of the motion's period below.
    longest_hop_1, longest_hop_2 : float
        Longest time that each end is off the plate at once, of the hops that ended in those periods or go on at the
        end [forcing periods]. From 0.5 on a ball counts as flying.
    change_ahead : float
        Of a run that stopped before the periods asked for: the largest change that its numbers would still make in the
        others, extrapolated; 0 of a run that made them all, or rests. It is relative of the orbit's radius, period, speed,
        precession rate, of the spin of any motion, and of the angle that its heading turns by where that is more than 1 rad; it
        is absolute of zeta [rad], impact phase [cycles] and the longest hops [forcing periods].
    centre_velocity_x, centre_velocity_y : float
        Velocity of the circle's centre relative to the plate [m/s]: the displacement from a heading to the same heading, over
        the last whole turn, by its time. 0 on a level plate; NaN where no whole turn was made since the motion settled, or
        since its heading turned back.

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
    orbit: Orbit | Absent
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
        """Time that was run [s].

        Examples
        --------
        >>> from dimersweep import simulate
        >>> simulate(f=15, periods=60).duration
        4.0
        """
        return self.n_periods / self.parameters["f"]

    @property
    def end_speed(self) -> float:
        """Speed of the centre of mass over the floor at the end [m/s]: a dimer whose ends stay down may roll or slide on.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> run = simulate(beta0="10 deg", periods=60)
        >>> run.mode, round(run.end_speed, 3)
        ('rest', 0.725)
        """
        return float("nan") if self._end is None else float(np.hypot(*self._end.start[0, [CA, CB]]))

    def conditions(self, always: Collection[str] = CAPTION, *, tex: bool = False) -> str:
        """The parameters of this run in words: those of the paper's captions, and all that differ from the base case.

        Parameters
        ----------
        always : collection of str
            Parameters that are named in any case.
        tex : bool
            Whether symbols are in TeX, else in plain letters.

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
        """The kernel's rows of this run, for what is `wanted` of them.

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
        """What the record lacks of the run, in words: all of it, or what is beyond its end; "" if nothing.

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
        """The events of the run, along `event`, in order of time.

        An impact has one row for each of its contact states, all at the same time, with its own share of the impulses.
        The velocity of a contact point that takes no part in an impact is NaN. A chatter ends where its bounces accumulate,
        or at the next event if it comes before. A slip that ends where nothing holds it goes on in another direction: its
        cause is slip, and not stick. Kinds, causes and contact states are flags, see `names`.

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
        """The state at any times: moved in closed form, or integrated to `rtol`, from the event before each of them.

        At the time of an event it is the state right after it, and so at t = 0, where the plate hits p1.

        Parameters
        ----------
        t : float or array_like, shape (n,)
            Times since the start [s], in any order.

        Returns
        -------
        xarray.Dataset
            Along `time`; scalars for one time.

        Raises
        ------
        ParameterError
            If nothing was recorded, a time is none or outside the run, or a phase of contact before it is so long that its
            steps are more than their bound.

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
        """The energy budget: what the plate gives, and what restitution and slip take, at each end.

        The plate gives by its normal force and, where it moves along itself, by friction. All terms are works on the dimer, so
        that what takes energy is below zero. `energy` follows from the states alone, the works from the forces and the law of
        impact (Eqs. 4, 6, 7), and ride along with the run, which is made once more for them; `residual` is what the change of
        the one is more than the sum of the others, and the attribute `closure` tells how large it becomes. The budget begins
        right after the impact at the start.

        Parameters
        ----------
        by : {"period", "event"}
            Whether the works are summed over each forcing period, along `n`, or given for each smooth phase and of each contact
            state of an impact, along `part`.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        ParameterError
            If nothing was recorded, or `by` is none of these.

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
        """States at which a map can be looked at: those of the return map, of impacts, or of a phase of the plate.

        Parameters
        ----------
        at : {"period", "double_impact", "landing_1", "landing_2"}
            The start of each forcing period, and the end of the last one; right after each impact that begins with both ends
            on the plate; right after each landing of p1 or p2, every bounce of a chatter being one that is not summed.
        phase : float or str, optional
            In place of the start of a period: a phase of the plate, omega t + phi0 [rad].

        Returns
        -------
        xarray.Dataset
            As `states`, along `n`: the number of forcing periods since the start, or that of the point. At an impact also
            the rates of the gaps before it.

        Raises
        ------
        ParameterError
            If nothing was recorded, `at` is none of these, or a phase is given with an impact.

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
        """This run made longer by so many forcing periods.

        It goes on from the state at the end of the last period, and holds the whole: n and m periods in two parts
        are n + m at once. All of 250 random runs are so bit for bit; where a contact at that moment is undecided to the
        accuracy, the last digits may differ within `rtol`.

        Parameters
        ----------
        periods : int

        Returns
        -------
        Run
            Recorded if this one is.

        Raises
        ------
        ParameterError
            If the run did not reach its end, or would become too long to be recorded.

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
        """Write the run to one NetCDF file, from which `load_run` gives it back, exactly.

        Parameters
        ----------
        path : path-like
        force : bool
            Whether an existing file may be replaced.

        Raises
        ------
        ParameterError
            If it does not end in .nc.
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
        """Heights, orbit and phase portraits, and a picture of them at `path` if one is given; `look` as in `plots.Look`.

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
            Ends in .gif; in .mp4 (needs ffmpeg); or in .html, for one page that plays in a browser without a network.
        periods : int
            Forcing periods to show; of a run that has fewer, all.
        speed : float
            Seconds of the run in one of the movie [1].
        fps : int
            Frames in one second of the movie. A GIF has at most 50; a page leaves out those that a browser has no time for.
        slow_impacts : bool
            Whether time runs 20 times slower around double impacts.
        last : bool
            Whether the end of the run is shown, else its start.
        dpi : int
            Dots per inch of a GIF or video of 7.2 by 3.7 inches; 600 at most.
        force : bool
            Whether an existing file may be replaced.

        Returns
        -------
        Path

        Raises
        ------
        ParameterError
            If nothing was recorded, the run ended before a forcing period, or the movie would be too long.
        StoreError
            If the file cannot be written, or what it needs is not installed.

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
        """The run in motion, in a notebook: the dimer on its plate, its heights, its track and its numbers.

        It is the page of `dimersweep explore` without its sliders, and holds all that it shows.

        Parameters
        ----------
        periods : int
            Forcing periods to show; of a run that has fewer, all.
        last : bool
            Whether the end of the run is shown, else its start.

        Returns
        -------
        View
            What a notebook shows; its `html` is the page.

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
        """Bounds on the errors of this run, estimated with two more runs that shadow it (docs/trust.md).

        Parameters
        ----------
        t : float or array_like, shape (n,), optional
            Times since the start [s]; the ends of all forcing periods are added.

        Returns
        -------
        xarray.Dataset
            Along `time`, for each quantity of `states`, a bound on its error up to then, in its unit, and `scaled`, the
            largest of those of the closed state in units of 1 cm, 0.1 m/s, 1 rad and 1 rad/s (gamma: 10 and 100 of them).
            Along `event`, the bound on the error of its time [s]; NaN for an event that a shadow lacks. `slip_undecided` is
            the time [s] of the first double impact in which a slip passes zero and `rtol` decides whether `mu_s` holds it,
            NaN if there is none.

        Raises
        ------
        ParameterError
            If nothing was recorded, the run did not reach its end, or a time is none or outside the run.

        Examples
        --------
        >>> from dimersweep import simulate
        >>> run = simulate(periods=60)
        >>> bounds = run.error()
        >>> bounds["x"].sel(time=run.duration).item() < 1e-6  # [m]
        True
        """
        from dimersweep.runs.shadows import bounds, starts_beside

        self.record("error")
        if self.status != "ok":
            raise ParameterError(f"error: the run did not reach its end ({self.message})")
        if self.record_cut:
            raise ParameterError(f"error: needs the whole record, but {self.record_cut}")
        times = np.arange(self.n_periods + 1) / self.parameters["f"]
        times = np.union1d(times, [] if t is None else self.states(t)["time"])
        rtol, starts = starts_beside(self.rtol, self.parameters, self.start)
        how = exactly(self.n_periods, rtol)

        def call(space: Workspace) -> list[Run]:
            return [simulate_checked(Parameters(**given), how, space, begun=begun) for given, begun in starts]

        return bounds(self, stoppable(call), times, 1 / self.parameters["f"])


def as_run(parameters: dict[str, float], rtol: float, solved: Solved, start: dict[str, float] | None) -> Run:
    """A run from what the kernel has filled in."""
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
    """The run that `simulate` gives for what it has checked, on scratch arrays that may be stopped.

    The state `begun` is that of a dimer of the parameters `before`, if there are any, as these have it.
    """
    row, first = parameters.row(), None
    if begun is not None:
        begun = {name: value for name, value in begun.items() if name != "phase"}  # which is phi0 now
        shaped = parameters if before is None else replace(before, phi0=parameters.phi0)
        as_told = kernel_start(begun, shaped.given())
        first = fitted(as_told, shaped.row(), row)
        begun = begun if first is as_told else named_state(row, first)
    solved = run_row(row, first, how, space, record=record)
    return as_run(parameters.given(), how.rtol, solved, begun)


def proven_run(call: Callable[[Workspace], Run], seconds: float | None = None) -> Run:
    """The run that `call` makes on scratch arrays, by a kernel that is known to work; see `stoppable`."""
    if not is_proven():
        stoppable(lambda _: prove())  # to compile is no part of the run's time
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
        With the same events and states, bit for bit, on the machine and the version that wrote it.

    Raises
    ------
    StoreError
        If there is no such file, or it is no run, or one that is damaged.

    Examples
    --------
    >>> from dimersweep import load_run, simulate
    >>> path = simulate(periods=60).save("walk.nc", force=True)
    >>> load_run(path).mode
    'drift'
    """
    from dimersweep.runs.saving import read_run

    return Run(**read_run(path))
