"""Claims of Sect. 3: the drift mode of the base case."""

import numpy as np

from dimersweep.claims.lab import Lab, orbit_of
from dimersweep.claims.ledger import Finding, claim, verdict
from dimersweep.cubes.cube import names
from dimersweep.cubes.reading import circle_through
from dimersweep.runs.run import Run


def last_cycle(run: Run, points: int = 20_001) -> np.ndarray:
    """Times of the last full cycle, from just before a double impact to just before the next [s]."""
    T = 1 / run.parameters["f"]
    kinds = run.events["kind"].values
    last = run.events["time"].values[np.char.startswith(kinds, "DI")][-1]
    return np.linspace(last - T, last, points)[:-1] - 1e-6 * T


def double_impact(run: Run) -> list[str]:
    """Contact states of the last double impact, in their order."""
    rows = run.events.isel(event=np.flatnonzero(run.events["cause"].values == "impact"))
    double = np.char.startswith(rows["kind"].values, "DI")
    last = rows["time"].values[double][-1]
    return rows["kind"].values[double & (rows["time"].values == last)].tolist()


def shares(run: Run) -> dict[str, float]:
    """Share of the last cycle that each contact state takes."""
    kinds, counts = np.unique(names(run.states(last_cycle(run))["contact_state"]), return_counts=True)
    return dict(zip(kinds.tolist(), (counts / counts.sum()).tolist(), strict=True))


@claim(
    "3.1",
    "The base case settles to a drift: B1 stays on the plate nearly all the time, B2 bounces in phase with the plate",
)
def base_drifts(lab: Lab) -> Finding:
    run = lab.base
    value = f"{run.mode}; p1 down {100 * run.down_share_1:.2f} % of the time, p2 {100 * run.down_share_2:.2f} %"
    holds = run.mode == "drift" and run.down_share_1 > 0.95 and run.down_share_2 < 0.05
    return Finding(value, verdict(holds), "p1 down for more than 95 %, p2 for less than 5 %")


@claim("3.1", "The event of double impacts begins in DI(sp,sp), goes over to DI(sp,sk) and stays so to its end")
def course_of_impact(lab: Lab) -> Finding:
    kinds = double_impact(lab.base)
    holds = kinds[0] == "DI_sp_sp" and kinds[-1] == "DI_sp_sk"
    return Finding(" then ".join(kinds), verdict(holds), "order of the contact states in the last double impact")


@claim("3.1", "The double impact comes in the first quadrant of the plate's cycle")
def first_quadrant(lab: Lab) -> Finding:
    phase, change = orbit_of(lab.base).impact_phase, orbit_of(lab.base).impact_phase_drift
    value = f"at {phase:.5f} of the cycle (changes by {change:.0e} a period)"
    return Finding(value, verdict(0 < phase < 0.25), "phase between 0 and 0.25")


@claim("3.1", "At the double impact the normal velocity of p2 is opposite to that of the plate")
def opposite_velocities(lab: Lab) -> Finding:
    run = lab.base
    double = np.flatnonzero(np.char.startswith(run.events["kind"].values, "DI"))[-1]
    time = run.events["time"].values[double]
    before = run.states(time - 1e-9 / run.parameters["f"])
    plate = (before["z1_rate"] - before["gap_1_rate"]).item()
    p2 = plate + before["gap_2_rate"].item()
    return Finding(f"plate {plate:+.4f} m/s, p2 {p2:+.4f} m/s", verdict(plate * p2 < 0), "signs just before the impact")


@claim("3.1", "After the single impacts B1 keeps contact in the slip state SC_sp, until B2 lands")
def sliding_contact(lab: Lab) -> Finding:
    share = shares(lab.base)
    slip, stick = share.get("SC1_sp", 0.0), share.get("SC1_sk", 0.0)
    why = (
        "SC_sp for more than half of the cycle. With mu = 0.2 the friction brings the slip (2.3 mm/s at most) to zero "
        "within a quarter of a cycle, and then holds p1 rolling: |F_t| stays below mu_s F_n"
    )
    return Finding(f"SC_sp {100 * slip:.0f} % of the cycle, SC_sk {100 * stick:.0f} %", verdict(slip > 0.5), why)


@claim("3.2", "With DI(sp,sk) at its end the attitude angles theta, beta, gamma are periodic (in their rates)")
def angles_repeat(lab: Lab) -> Finding:
    run = lab.base
    end, T = run.n_periods / run.parameters["f"], 1 / run.parameters["f"]
    first, last = (run.states(end - k * T - 0.4 * T) for k in (1, 0))
    cycle = run.states(last_cycle(run))
    found = {
        name: abs(last[name].item() - first[name].item()) / np.ptp(cycle[name].values)
        for name in ("beta", "beta_rate", "theta_rate", "spin_rate")
    }
    value = ", ".join(f"{name} {change:.0e}" for name, change in found.items())
    why = "change from one cycle to the next, in units of the swing within a cycle, below 1 %"
    return Finding(value, verdict(max(found.values()) < 0.01), why)


@claim("3.2", "beta runs round a D-shaped limit cycle: a vertical line, the double impact, and an arc; asymmetric")
def d_shape(lab: Lab) -> Finding:
    run = lab.base
    states = run.states(last_cycle(run))
    beta, rate = states["beta"].values, states["beta_rate"].values
    value = f"beta {beta.min():.1e} to {beta.max():.4f} rad; rate from {rate[0]:.2f} to {rate[1]:.2f} rad/s at beta = 0"
    uneven = abs(rate[0]) / rate[1]
    holds = beta.min() > -1e-6 and rate[0] < 0 < rate[1] and uneven > 1.1
    return Finding(value, verdict(holds), f"beta >= 0, and the rate jumps from - to + with a ratio of {uneven:.2f}")


def _impact_changes(run: Run, name: str) -> dict[str, float]:
    """Change of a rate by the double impact and by the single impacts of the last cycle together."""
    times = last_cycle(run)
    rows = run.events
    inside = (rows["time"].values >= times[0]) & (rows["time"].values < times[-1]) & (rows["cause"].values == "impact")
    changes = {}
    for family in ("DI", "SI"):
        at = np.unique(rows["time"].values[inside & np.char.startswith(rows["kind"].values, family)])
        before = run.states(at - 1e-11)[name].values
        changes[family] = float((run.states(at)[name].values - before).sum())
    return changes | {"swing": float(np.ptp(run.states(times)[name].values))}


@claim("3.2", "Single and double impacts influence the rate of theta only slightly")
def theta_in_impacts(lab: Lab) -> Finding:
    found = _impact_changes(lab.base, "theta_rate")
    value = f"DI {found['DI']:+.1e}, SI {found['SI']:+.1e} of a swing of {found['swing']:.3f} rad/s"
    holds = max(abs(found["DI"]), abs(found["SI"])) < 0.05 * found["swing"]
    return Finding(value, verdict(holds), "both below 5 % of the swing")


@claim(
    "3.2",
    "The rate of gamma has a nonzero mean, changes little in a double impact, and falls dramatically in single impacts",
)
def gamma_in_impacts(lab: Lab) -> Finding:
    found = _impact_changes(lab.base, "spin_rate")
    mean = lab.base.states(last_cycle(lab.base))["spin_rate"].values.mean()
    value = (
        f"mean {mean:.1f} rad/s; DI {found['DI']:+.1e}, SI {found['SI']:+.1e} of a swing of {found['swing']:.2f} rad/s"
    )
    little = abs(found["DI"]) < 0.05 * found["swing"]
    falls = found["SI"] < -0.05 * found["swing"]
    why = "DI below 5 % of the swing, SI a fall of more than 25 %; rolling contact does the rest of the swing"
    return Finding(value, verdict(little and found["SI"] < -0.25 * found["swing"], little and falls), why)


@claim("3.3", "The path of the centre of mass is globally circular, with local fluctuations (Abstract, Fig. 6)")
def circular(lab: Lab) -> Finding:
    run = lab.base
    T = 1 / run.parameters["f"]
    states = run.states(np.arange(30, run.n_periods) * T)
    a, b, radius = circle_through(states["x"].values, states["y"].values)
    away = np.hypot(states["x"].values - a, states["y"].values - b) - radius
    most, told = float(np.abs(away).max()), orbit_of(run).radius
    value = f"circle of {radius:.4f} m, off by {1e6 * most:.0f} µm at most (once a period); R = v/omega = {told:.4f} m"
    holds = most < 0.01 * radius and abs(radius / told - 1) < 0.01
    return Finding(value, verdict(holds), "both within 1 % of the radius")
