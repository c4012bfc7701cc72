"""Draw one recorded run: heights, orbit, phase portraits with their contact states, and its energy budget."""

from typing import Any, Unpack

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from dimersweep.cubes.cube import OF_A_RUN, Column, finished, names, table
from dimersweep.cubes.seen_run import SeenRun, check_shown
from dimersweep.inputs import as_number, as_numbers
from dimersweep.kernel.model.contact_code import CONTACT_STATES
from dimersweep.parameters import dimer_from
from dimersweep.plots.style import MODE_COLORS, Look, beyond_round_off, board, ink
from dimersweep.symbols import EVENT_QUANTITIES, STATE_QUANTITIES

# labels of the angles in phase portraits
ANGLES = {
    "beta": r"$\beta$ [rad]",
    "theta": r"$\theta - \theta_0$ [rad]",
    "gamma": r"$\gamma - \gamma_0$ [rad]",
}
# terms of the energy budget: label and colour, dark at p1 and light at p2
TERMS = {
    "plate_1": ("from the plate, $p_1$", "#1b7837"),
    "plate_2": ("from the plate, $p_2$", "#7fbf7b"),
    "plate_along": ("from the plate along itself", "#e69f00"),
    "restitution_1": ("restitution, $p_1$", "#2166ac"),
    "restitution_2": ("restitution, $p_2$", "#92c5de"),
    "slip_1": ("slip, $p_1$", "#b2182b"),
    "slip_2": ("slip, $p_2$", "#f4a582"),
}
SLIPS = ("slip_1", "slip_2")  # terms that are hatched: some readers cannot tell red and green apart
# share of the greatest work below which the axis is linear, and below which a contact state has no row
SMALLEST = 1e-6


def last_cycle(run: SeenRun) -> tuple[float, float]:
    """Return start and stop of the last full cycle of a recorded run [s].

    If there is a double impact in it, the cycle starts just before the impact.

    Examples
    --------
    >>> from dimersweep import plots, simulate
    >>> run = simulate(periods=60)
    >>> start, stop = plots.last_cycle(run)
    >>> round(15 * float(stop - start), 6)
    1.0
    """
    check_shown(run, "last_cycle")
    end, cycle = run.n_periods / run.parameters["f"], max(1, run.mode_period) / run.parameters["f"]
    times = run.events["time"].values[names(run.events["kind"]).str.startswith("DI")]
    recent = times.size > 0 and times[-1] >= end - cycle
    # just before the last double impact: the cycle then begins with the one before, and does not end within this one
    stop = times[-1] - 1e-6 * cycle if recent else end
    return max(0.0, stop - cycle), stop


def impact_rates(run: SeenRun, time: float) -> xr.Dataset:
    """Return the rates of the three angles through a double impact.

    Both ends are on the plate. So the gap rates give beta', and the lateral slips give the lateral impulses, which
    change theta' and the spin.

    Parameters
    ----------
    run : Run
        A recorded run.
    time : float
        Time of the double impact, as in ``run.events`` [s].

    Returns
    -------
    xarray.Dataset
        `beta_rate`, `theta_rate`, `gamma_rate` [rad s-1] along `stage`: before the impact, then after each of its rows.
        `kind` is the kind of the row, and before the impact the contact state.

    Examples
    --------
    >>> from dimersweep import names, plots, simulate
    >>> run = simulate(periods=60)
    >>> double = names(run.events["kind"]).str.startswith("DI")
    >>> rates = plots.impact_rates(run, float(run.events["time"][double][-1]))
    >>> sorted(rates.data_vars)
    ['beta_rate', 'gamma_rate', 'kind', 'theta_rate']
    """
    dm, time = dimer_from(run.parameters), as_number("time", time, "s")
    struck = (run.events["time"] == time) & (names(run.events["cause"]) == "impact")
    rows = run.events.isel(event=np.flatnonzero(struck))
    # the state at the time of an event is the one right after it
    before = run.states(max(0.0, time - 1e-9 * dm.period))
    theta, theta_rate = float(before["theta"]), float(before["theta_rate"])
    # lateral velocity of each end per theta' cos(beta) and per axial spin; change of these rates per unit of its
    # impulse
    levers = np.array([[end.r * dm.sin_0 - end.h, -end.r * dm.cos_0] for end in (dm.p1, dm.p2)])
    gives = levers * [dm.it, dm.ia]
    turning = np.array([theta_rate * dm.cos_0, float(before["gamma_rate"]) + theta_rate * dm.sin_0])
    across = float(before["x1_rate"]) * np.cos(theta) + float(before["y1_rate"]) * np.sin(theta) + dm.p1.h * turning[0]
    slips = np.array([rows["slip_1_b"], rows["slip_2_b"]]) - (across + levers @ turning)[:, None]
    turned = turning[:, None] + gives.T @ np.linalg.solve(dm.im + gives @ levers.T, slips)
    dip = (rows["gap_2_rate_after"] - rows["gap_1_rate_after"]) / (dm.l * dm.cos_0)
    turn = turned[0] / dm.cos_0
    course = {
        "beta_rate": np.append(float(before["beta_rate"]), dip),
        "theta_rate": np.append(theta_rate, turn),
        "gamma_rate": np.append(float(before["gamma_rate"]), turned[1] - turn * dm.sin_0),
    }
    kinds = np.append(rows["contact_before"][:1], rows["kind"])
    columns = [Column(name, STATE_QUANTITIES[name], values) for name, values in course.items()]
    columns += [Column("kind", EVENT_QUANTITIES["kind"], kinds, CONTACT_STATES)]
    return finished(table((), columns, "stage"), f"Rates through a double impact {OF_A_RUN}")


def portrait(axes: Axes, run: SeenRun, angle: str, span: tuple[float, float], *, color: str | None = None) -> None:
    """Draw the phase portrait of an angle, with its contact states as in the paper's Fig. 3.

    Lines are solid in free motion and single impacts, and dashed in contact. In a double impact there are dots while
    both ends slip, and circles while one sticks.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    run : Run
        A recorded run.
    angle : str
        beta, theta or gamma; theta and gamma are counted from the start.
    span : tuple of float
        Start and stop [s].
    color : str, optional
        Colour of lines and marks, by default that of text.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from dimersweep import plots, simulate
    >>> run = simulate(periods=60)
    >>> figure = Figure()
    >>> plots.portrait(figure.subplots(), run, "beta", plots.last_cycle(run))
    >>> figure.savefig("portrait.png")
    """
    color = color or ink()
    start, stop = as_numbers("span", span, "s")
    shown = (run.events["time"] >= start) & (run.events["time"] < stop)
    events = names(run.events.isel(event=np.flatnonzero(shown)))
    jumps = np.unique(events["time"].values[events["cause"].values == "impact"])
    # both sides of each jump: the state at the time of an event is the one right after it
    just_before = np.maximum(start, jumps - 1e-9 / run.parameters["f"])
    states = run.states(np.sort(np.concatenate([np.linspace(start, stop, 2001), just_before, jumps])))
    values = states[angle].values - (0.0 if angle == "beta" else states[angle].values[0])
    rates = states[f"{angle}_rate"].values
    style = np.where(states["contact_state"].values == 0, "-", "--")
    double = np.isin(states["time"].values, events["time"].values[events["kind"].str.startswith("DI")])
    # a piece of the curve ends where the style changes, or at a double impact, which is drawn by itself
    breaks = np.flatnonzero((style[1:] != style[:-1]) | double[1:]) + 1
    for first, last in zip([0, *breaks], [*breaks, style.size], strict=True):
        stop = last + 1 if last < style.size and not double[last] else last
        axes.plot(values[first:stop], rates[first:stop], style[first], color=color, linewidth=1.2)
    for k in (values.size // 5, 3 * values.size // 4):
        tip = {"arrowstyle": "-|>", "color": color, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (values[k + 9], rates[k + 9]), (values[k], rates[k]), arrowprops=tip)
    for k in np.flatnonzero(double):
        _impact_marks(axes, impact_rates(run, states["time"].values[k]), f"{angle}_rate", values[k], color)
    axes.set(xlabel=ANGLES[angle], ylabel=f"$\\dot{{\\{angle}}}$ [rad/s]")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.ticklabel_format(axis="x", scilimits=(-2, 4), useMathText=True)
    axes.ticklabel_format(axis="y", useOffset=False)
    beyond_round_off(axes)


def strobes(axes: Axes, run: SeenRun, angle: str) -> None:
    """Draw the rate of an angle at the start of each forcing period, for a motion that does not repeat.

    The rate of beta is drawn over beta. Precession and spinning angle have no bounds: their rates are drawn over the
    rates one period before.
    """
    section = run.section()
    rates = section[f"{angle}_rate"].values
    letter, cycles = rf"\dot{{\{angle}}}", section["n"].values
    if angle == "beta":
        x, y = section["beta"].values, rates
        axes.set(xlabel=ANGLES[angle], ylabel=f"${letter}$ [rad/s]")
    else:
        x, y, cycles = rates[:-1], rates[1:], cycles[1:]
        axes.set(xlabel=f"${letter}_n$ [rad/s]", ylabel=f"${letter}_{{n+1}}$ [rad/s]")
    later = cycles >= cycles[-1] // 2  # the first half may have transients
    axes.plot(x[later], y[later], ".", color=MODE_COLORS["aperiodic"], markersize=3)
    axes.xaxis.set_major_locator(MaxNLocator(5))


def _impact_marks(axes: Axes, course: xr.Dataset, name: str, value: float, color: str) -> None:
    """Draw a double impact in a phase portrait, as a vertical line of marks along each of its rows."""
    rates, kinds = course[name].values, names(course["kind"]).values
    step = np.ptp(rates) / 14 or 1.0
    for start, stop, kind in zip(rates[:-1], rates[1:], kinds[1:], strict=True):
        marks = np.linspace(start, stop, max(2, round(abs(stop - start) / step) + 1))[1:]
        face, size = ("none", 4) if "sk" in kind else (color, 2.5)
        axes.plot(np.full(marks.size, value), marks, "o", color=color, markerfacecolor=face, markersize=size)


def heights(axes: Axes, run: SeenRun, span: tuple[float, float]) -> None:
    """Draw plate, p1 and p2 against time in forcing periods, as in the paper's Fig. 2; `span` is start and stop [s].

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from dimersweep import plots, simulate
    >>> run = simulate(periods=60)
    >>> figure = Figure()
    >>> plots.heights(figure.subplots(), run, (3.0, 3.2))
    >>> figure.savefig("heights.png")
    """
    start, stop = as_numbers("span", span, "s")
    states = run.states(np.linspace(start, stop, 2001))
    cycles = states["time"].values * run.parameters["f"]
    plate = states["plate"]
    axes.plot(cycles, 1e3 * (plate + states["gap_2"]), color=ink(), linewidth=1, label="$p_2$")
    axes.plot(cycles, 1e3 * (plate + states["gap_1"]), color="#d62728", linewidth=3, zorder=1.9, label="$p_1$")
    axes.plot(cycles, 1e3 * plate, "--", color="#56b4e9", linewidth=1.2, label="plate")
    axes.set(xlabel="time [forcing periods]", ylabel="height [mm]")
    close = {"ncols": 3, "columnspacing": 1.0, "handlelength": 1.0, "frameon": False}
    axes.legend(fontsize="small", loc="lower right", bbox_to_anchor=(1, 1), **close)


def orbit(axes: Axes, run: SeenRun, arrows: int = 8) -> None:
    """Draw the path of the centre of mass from above, as in the paper's Fig. 6, with arrows of its velocity.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from dimersweep import plots, simulate
    >>> run = simulate(periods=60)
    >>> figure = Figure()
    >>> plots.orbit(figure.subplots(), run)
    >>> figure.savefig("orbit.png")
    """
    check_shown(run, "plot")
    end = run.n_periods / run.parameters["f"]
    states = run.states(np.linspace(0.0, end, min(40 * run.n_periods, 40_000) + 1))
    x, y = states["x"].values, states["y"].values
    axes.plot(x, y, color="#d62728", linewidth=1)
    step = (x.size - 1) // run.n_periods
    at = np.linspace(0, x.size - 1 - step, arrows).astype(int)
    # displacement over a whole forcing period: the mean velocity, without the wobble within a period
    u, v = x[at + step] - x[at], y[at + step] - y[at]
    # the longest arrow is a ninth of the path's extent; 1e-300 stands in for a dimer that does not move
    scale = 9 * max(np.hypot(u, v).max(), 1e-300) / (max(np.ptp(x), np.ptp(y)) or 1.0)
    how: Any = {"color": "#0072b2", "width": 5e-3, "zorder": 3}
    axes.quiver(x[at], y[at], u, v, angles="xy", scale_units="xy", scale=scale, **how)
    axes.update_datalim(np.column_stack([x[at] + u / scale, y[at] + v / scale]))  # so that heads of arrows are not cut
    axes.plot(x[:1], y[:1], "o", color=ink(), markersize=5, label="start")
    axes.set(aspect="equal", adjustable="datalim", xlabel="$x$ [m]", ylabel="$y$ [m]")
    axes.legend(fontsize="small", loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    beyond_round_off(axes)


def run_figure(run: SeenRun, periods: int = 4, **look: Unpack[Look]) -> Figure:
    """Draw one run: normal displacements, orbit of the centre of mass, and the phase portraits of its last cycle.

    Parameters
    ----------
    run : Run
        A recorded run.
    periods : int
        Forcing periods of the normal displacements to show, up to the end.
    **look : see `Look`

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ParameterError
        If nothing was recorded, or the run ended before a forcing period.

    Examples
    --------
    >>> from dimersweep import plots, simulate
    >>> run = simulate(periods=60)
    >>> plots.run_figure(run).savefig("run.png")
    """
    check_shown(run, "plot")
    end, f = run.n_periods / run.parameters["f"], run.parameters["f"]
    heading = f"{run.mode} after {run.n_periods} periods: {run.conditions(tex=True)}"
    drawn, panels = board(look, (11, 7), heading, mosaic=[["heights", "heights", "orbit"], [*ANGLES]])
    heights(panels["heights"], run, (max(0.0, end - periods / f), end))
    orbit(panels["orbit"], run)
    aperiodic = run.mode == "aperiodic"
    for angle in ANGLES:
        strobes(panels[angle], run, angle) if aperiodic else portrait(panels[angle], run, angle, last_cycle(run))
    titles = ("normal displacements", "centre of mass", "dip", "precession", "spinning")
    for letter, title, axes in zip("abcde", titles, panels.values(), strict=True):
        axes.set_title(f"({letter}) {title}", loc="left", fontsize="small")
    if not aperiodic:
        drawn.legend("lower center", contact_legend(), ncols=4, fontsize="small", frameon=False)
    return drawn.done()


def contact_legend(color: str | None = None) -> list[Line2D]:
    """Return handles of a legend for `portrait`; their colour is that of text by default.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from dimersweep import plots
    >>> legend = Figure().legend(handles=plots.contact_legend())
    >>> legend.get_texts()[1].get_text()
    'contact'
    """
    color = color or ink()
    return [
        Line2D([], [], color=color, linestyle="-", label="free motion, single impacts"),
        Line2D([], [], color=color, linestyle="--", label="contact"),
        Line2D([], [], color=color, linestyle="", marker="o", markersize=2.5, label="double impact, both slip"),
        Line2D([], [], color=color, linestyle="", marker="o", fillstyle="none", markersize=4, label="..., one sticks"),
    ]


def energy_budget(axes: Axes, run: SeenRun, periods: int = 12) -> None:
    """Draw the works in each contact state, per forcing period, over the last periods of a run.

    Each term is a bar, on a symmetric logarithmic axis.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    run : Run
        A recorded run.
    periods : int
        Forcing periods over which the mean is taken, at most those of the run.

    Raises
    ------
    ParameterError
        If nothing was recorded, or the run ended before a forcing period.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from dimersweep import plots, simulate
    >>> figure = Figure()
    >>> plots.energy_budget(figure.subplots(), simulate(periods=60))
    """
    check_shown(run, "energy_budget")
    budget, f = run.energy("event"), run.parameters["f"]
    count = min(periods, run.n_periods)
    # 1e-12: round-off must not drop what happens at the start of the first of these periods
    late = budget.isel(part=np.flatnonzero(budget["time"].values >= (run.n_periods - count) / f * (1 - 1e-12)))
    works = late[list(TERMS)].to_dataframe()[list(TERMS)].groupby(names(late["kind"]).values, sort=False).sum() * (
        1e6 / count
    )
    greatest = works.abs().to_numpy().max(initial=0.0)
    axes.set_xlabel("work on the dimer, per forcing period [µJ]")
    if not greatest:
        axes.set_yticks([])
        axes.set_title("no work is done", fontsize="small")
        return
    works = works[works.abs().max(axis=1) > SMALLEST * greatest]
    works.loc["all"] = works.sum()
    used, rows = [term for term in TERMS if works[term].any()], np.arange(len(works))
    height = 0.8 / len(used)
    for k, term in enumerate(used):
        label, color = TERMS[term]
        hatch = "////" if term in SLIPS else None
        axes.barh(rows + (k + 0.5) * height - 0.4, works[term], height, color=color, label=label, hatch=hatch)
    axes.set_xscale("symlog", linthresh=SMALLEST * 10 ** np.ceil(np.log10(greatest)))
    axes.axvline(0.0, color=ink(), lw=0.8)
    axes.set_yticks(rows, works.index)
    axes.set_ylim(len(works) - 0.5, -0.5)
    for row in rows[:-1]:
        axes.axhline(row + 0.5, color="0.85", lw=0.6)
    ticks = 10.0 ** (np.ceil(np.log10(greatest)) + np.arange(-5, 1, 2))
    axes.set_xticks(np.concatenate([-ticks[::-1], [0.0], ticks]))
    axes.minorticks_off()
