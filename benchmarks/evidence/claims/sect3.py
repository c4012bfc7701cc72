"""Claims of Sect. 3: the drift mode of the base case."""

import numpy as np
from lab import Lab, drift_orbit
from ledger import Finding, claim, found

from dimersweep import Run, names
from dimersweep.analysis.orbits.map.ball import ball_fold
from dimersweep.cubes.findings import circle_through


def cycle_times(run: Run) -> np.ndarray:
    """Times of the last full cycle, from just before a double impact to just before the next [s]."""
    T = 1 / run.parameters["f"]
    kinds = names(run.events["kind"]).values
    last = run.events["time"].values[np.char.startswith(kinds, "DI")][-1]
    return np.linspace(last - T, last, 20_001)[:-1] - 1e-6 * T


def last_double_impact(run: Run) -> list[str]:
    """Contact states of the last double impact, in their order."""
    rows = names(run.events)
    rows = rows.isel(event=np.flatnonzero(rows["cause"] == "impact"))
    double = np.char.startswith(rows["kind"].values, "DI")
    last = rows["time"].values[double][-1]
    return rows["kind"].values[double & (rows["time"].values == last)].tolist()


def slip_of_p1(run: Run) -> np.ndarray:
    """Slip of p1 along the axis and across it in the last cycle, shape (2, n) [m s-1]; NaN while p1 is off the plate."""
    states, r = run.states(cycle_times(run)), run.parameters["r"]
    theta, beta = states["theta"].values, states["beta"].values
    vx, vy = states["x1_rate"].values, states["y1_rate"].values
    along = -np.sin(theta) * vx + np.cos(theta) * vy + r * states["beta_rate"].values
    across = np.cos(theta) * vx + np.sin(theta) * vy - r * np.cos(beta) * states["gamma_rate"].values
    down = np.char.startswith(names(states["contact_state"]).values.astype(str), "SC1")
    return np.where(down, [along, across], np.nan)


def state_shares(run: Run) -> dict[str, float]:
    """Share of the last cycle that each contact state takes."""
    kinds, counts = np.unique(names(run.states(cycle_times(run))["contact_state"]), return_counts=True)
    return dict(zip(kinds.tolist(), (counts / counts.sum()).tolist(), strict=True))


@claim(
    "3.1",
    "The base case settles to a drift: B1 stays on the plate nearly all the time, B2 bounces in phase with the plate",
    "p1 down for more than 95 % of the time, p2 for less than 5 %",
)
def base_drifts(lab: Lab) -> Finding:
    run = lab.base
    value = f"{run.mode}; p1 down {100 * run.down_share_1:.2f} % of the time, p2 {100 * run.down_share_2:.2f} %"
    return found(value, run.mode == "drift" and run.down_share_1 > 0.95 and run.down_share_2 < 0.05)


@claim(
    "3.1",
    "The event of double impacts begins in DI(sp,sp), goes over to DI(sp,sk) and stays so to its end",
    "order of the contact states in the last double impact",
)
def course_of_impact(lab: Lab) -> Finding:
    kinds = last_double_impact(lab.base)
    course = [kind for kind, before in zip(kinds, ["", *kinds], strict=False) if kind != before]
    return found(
        " then ".join(course),
        course == ["DI_sp_sp", "DI_sp_sk"],
        reason="it takes another course: the friction is not that of the base case",
    )


@claim("3.1", "The double impact comes in the first quadrant of the plate's cycle", "phase between 0 and 0.25")
def first_quadrant(lab: Lab) -> Finding:
    phase, change = drift_orbit(lab.base).impact_phase, drift_orbit(lab.base).impact_phase_drift
    p = lab.base.parameters
    ball = np.arccos(ball_fold(p["e"]) / p["Gamma"]) / (2 * np.pi)
    value = f"at {phase:.5f} of the cycle (changes by {change:.0e} a period); a ball, in closed form: {ball:.4f}"
    return found(value, 0 < phase < 0.25)


@claim(
    "3.1",
    "At the double impact the normal velocity of p2 is opposite to that of the plate",
    "signs just before the impact",
)
def opposite_velocities(lab: Lab) -> Finding:
    run = lab.base
    double = np.flatnonzero(np.char.startswith(names(run.events["kind"]).values, "DI"))[-1]
    time = run.events["time"].values[double]
    before = run.states(time - 1e-9 / run.parameters["f"])
    plate = (before["z1_rate"] - before["gap_1_rate"]).item()
    p2 = plate + before["gap_2_rate"].item()
    return found(f"plate {plate:+.4f} m/s, p2 {p2:+.4f} m/s", plate * p2 < 0)


@claim(
    "3.1",
    "After the single impacts B1 keeps contact in the slip state SC_sp, until B2 lands",
    "SC_sp for more than half of the cycle",
)
def sliding_contact(lab: Lab) -> Finding:
    share = state_shares(lab.base)
    slip, stick = share.get("SC1_sp", 0.0), share.get("SC1_sk", 0.0)
    fastest = np.nanmax(np.hypot(*slip_of_p1(lab.base)))
    reason = (
        f"friction mu F_n stops the slip ({1e3 * fastest:.1f} mm/s at most), and p1 then rolls for {100 * stick:.0f} % "
        "of the cycle, as rolling never takes mu_s F_n; held by mu it slips on, so rolling takes more than mu F_n"
    )
    return found(f"SC_sp {100 * slip:.0f} % of the cycle, SC_sk {100 * stick:.0f} %", slip > 0.5, reason=reason)


@claim(
    "3.2",
    "With DI(sp,sk) at its end the attitude angles theta, beta, gamma are periodic (in their rates)",
    "change from one cycle to the next below 1 % of the swing within a cycle; partly: of all but gamma",
)
def angles_repeat(lab: Lab) -> Finding:
    run = lab.base
    end, T = run.n_periods / run.parameters["f"], 1 / run.parameters["f"]
    first, last = (run.states(end - k * T - 0.4 * T) for k in (1, 0))
    cycle = run.states(cycle_times(run))
    change = {
        name: last[name].item() - first[name].item() for name in ("beta", "beta_rate", "theta_rate", "gamma_rate")
    }
    shares = {name: abs(by) / np.ptp(cycle[name].values) for name, by in change.items()}
    others = max(share for name, share in shares.items() if name != "gamma_rate")
    value = ", ".join(f"{name} {share:.0e}" for name, share in shares.items())
    reason = (
        f"the spin is not sustained but drifts slowly along the slow family, by {change['gamma_rate']:+.1e} rad/s a period of "
        f"{last['gamma_rate'].item():.1f} rad/s, while beta and the rate of theta repeat to {others:.0e}"
    )
    return found(value, max(shares.values()) < 0.01, partly=others < 0.01, reason=reason)


@claim(
    "3.2",
    "beta runs round a D-shaped limit cycle: a vertical line, the double impact, and an arc; asymmetric",
    "beta >= 0, and the rate jumps from - to + by unequal amounts, with a ratio above 1.1",
)
def d_shape(lab: Lab) -> Finding:
    states = lab.base.states(cycle_times(lab.base))
    beta, rate = states["beta"].values, states["beta_rate"].values
    uneven = abs(rate[0]) / rate[1]
    value = (
        f"beta {beta.min():.1e} to {beta.max():.4f} rad; rate from {rate[0]:.2f} to {rate[1]:.2f} rad/s at beta = 0, "
        f"a ratio of {uneven:.2f}"
    )
    return found(value, beta.min() > -1e-6 and rate[0] < 0 < rate[1] and uneven > 1.1)


def _impact_changes(run: Run, name: str) -> dict[str, float]:
    """Change of a rate by the double impact and by the single impacts of the last cycle together."""
    times = cycle_times(run)
    rows = names(run.events)
    inside = (rows["time"].values >= times[0]) & (rows["time"].values < times[-1]) & (rows["cause"].values == "impact")
    changes = {}
    for family in ("DI", "SI"):
        at = np.unique(rows["time"].values[inside & np.char.startswith(rows["kind"].values, family)])
        before = run.states(at - 1e-11)[name].values
        changes[family] = float((run.states(at)[name].values - before).sum())
    return changes | {"swing": float(np.ptp(run.states(times)[name].values))}


@claim("3.2", "Single and double impacts influence the rate of theta only slightly", "both below 5 % of the swing")
def theta_in_impacts(lab: Lab) -> Finding:
    change = _impact_changes(lab.base, "theta_rate")
    value = f"DI {change['DI']:+.1e}, SI {change['SI']:+.1e} of a swing of {change['swing']:.3f} rad/s"
    return found(value, max(abs(change["DI"]), abs(change["SI"])) < 0.05 * change["swing"])


@claim(
    "3.2",
    "The rate of gamma has a nonzero mean, changes little in a double impact, and falls dramatically in single impacts",
    "DI below 5 % of the swing, SI a fall of more than 25 %; partly: of more than 5 %",
)
def gamma_in_impacts(lab: Lab) -> Finding:
    change = _impact_changes(lab.base, "gamma_rate")
    mean = lab.base.states(cycle_times(lab.base))["gamma_rate"].values.mean()
    value = f"mean {mean:.1f} rad/s; DI {change['DI']:+.1e}, SI {change['SI']:+.1e} of a swing of {change['swing']:.2f} rad/s"
    little = abs(change["DI"]) < 0.05 * change["swing"]
    share = 100 * change["SI"] / change["swing"]
    reason = (
        f"all single impacts of a cycle change it by {share:+.0f} % of its swing: the friction of the lasting contact, "
        "which acts for most of the cycle, does the rest"
    )
    return found(value, little and share < -25, partly=little and share < -5, reason=reason)


@claim(
    "3.3",
    "The path of the centre of mass is globally circular, with local fluctuations (Abstract, Fig. 6)",
    "off the circle by less than 1 % of its radius, once a period, and v/omega within 1 % of it",
)
def circular(lab: Lab) -> Finding:
    run = lab.base
    T = 1 / run.parameters["f"]
    states = run.states(np.arange(30, run.n_periods) * T)
    a, b, radius = circle_through(states["x"].values, states["y"].values)
    away = np.hypot(states["x"].values - a, states["y"].values - b) - radius
    most, expected = float(np.abs(away).max()), drift_orbit(run).radius
    value = f"circle of {radius:.4f} m, off by {1e6 * most:.0f} µm at most; R = v/omega = {expected:.4f} m"
    return found(value, most < 0.01 * radius and abs(radius / expected - 1) < 0.01)
