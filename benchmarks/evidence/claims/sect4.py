"""Claims of Sect. 4: what excites the drift, and what friction does to it."""

import numpy as np
import xarray as xr
from lab import Lab, drift_orbit
from ledger import Finding, claim, found
from sect3 import cycle_times, last_double_impact, slip_of_p1

from dimersweep import Run, names
from dimersweep.analysis.orbits.map.ball import ball_flip, ball_fold
from dimersweep.cubes.findings import drift_intervals, drift_lengths, runs_of, stick_ratio
from dimersweep.kernel.model.layout import M_DRIFT, M_REST, MODES
from dimersweep.parameters import dimer_from

NO_GROWTH = 1e-6  # growth of the radius a period that is none: a spiral of Fig. 10 shrinks by 1.7e-6


def drifting(cube: xr.Dataset, name: str) -> np.ndarray:
    """The values of a quantity where a point of the cube drifts."""
    values = cube[name].values[cube["mode"].values == M_DRIFT]
    return values[np.isfinite(values)]


def span(values: np.ndarray) -> float:
    """Greatest less least value, over their mean."""
    return float(np.ptp(values) / np.abs(values.mean()))


@claim(
    "4.1",
    "The initial velocity has no effect on the formation of the drift (xdot0 from 0.5 to 2.5)",
    "no start changes its verdict; partly: fewer than 10 % do",
)
def velocity_and_drift(lab: Lab) -> Finding:
    drift = (lab.speeds["mode"] == M_DRIFT).values
    differ = (drift != drift[1]).any(axis=0).mean()
    per_row = ", ".join(f"{100 * share:.1f} %" for share in drift.mean(axis=1))
    value = f"{100 * differ:.1f} % of the starts change their verdict with xdot0; drift from {per_row} of them"
    p = lab.base.parameters
    braking = p["xdot0"] / (p["mu"] * p["g"]) * p["f"]
    reason = (
        "without friction xdot0 is a change of frame and could change nothing, but Coulomb's law has one bound for both "
        f"directions: while p1 slips sideways (mu g stops 1 m/s in {braking:.0f} periods at most) next to no friction is "
        "left along the axis, where it turns the dimer, and that is when the basin is decided"
    )
    return found(value, differ == 0, partly=differ < 0.1, reason=reason)


@claim(
    "4.1",
    "The intervals of initial dip angles that drift get denser as the frequency rises (Fig. 7)",
    "their number rises with f",
)
def denser_intervals(lab: Lab) -> Finding:
    counts = [len(intervals) for intervals in drift_intervals(lab.dips)]
    value = f"{counts[0]}, {counts[1]}, {counts[2]} intervals at 15, 20, 25 Hz"
    return found(value, counts[0] < counts[1] < counts[2])


@claim(
    "4.1",
    "The total length of these intervals varies little with the frequency",
    "they differ by less than 15 % of their mean; partly: 30 %",
)
def interval_lengths(lab: Lab) -> Finding:
    lengths = drift_lengths(lab.dips).values
    step = float(np.diff(lab.dips["beta0"].values)[0])
    error = step * np.sqrt(np.mean([len(intervals) for intervals in drift_intervals(lab.dips)]) / 3)
    value = f"{lengths[0]:.3f}, {lengths[1]:.3f}, {lengths[2]:.3f} rad (each ± {error:.3f} by the grid)"
    f, p = lab.dips["f"].values, lab.base.parameters
    heights = dimer_from(p).l * f**2 / p["g"]
    reason = (
        f"what a start falls through, in the height of a bounce g/f^2, reaches up to {heights[0]:.2f}, {heights[1]:.2f}, "
        f"{heights[2]:.2f}: at 15 Hz only the first few intervals fit below pi/2, from 20 Hz on the lengths differ by "
        f"{100 * span(lengths[1:]):.0f} %"
    )
    return found(value, span(lengths) < 0.15, partly=span(lengths) < 0.3, reason=reason)


def kinetic_energy(run: Run) -> tuple[float, float]:
    """Energies per mass right after the double impact, from where it takes place [m2 s-2]: of the ball that bounces, of all."""
    dm = dimer_from(run.parameters)
    state = run.states(cycle_times(run)[[1]])
    turning = np.cos(state["beta"]) * state["beta_rate"]
    centre, bouncing = state["z1_rate"] - dm.p1.h * turning, state["z1_rate"] + dm.l * turning
    spin = 0.5 * dm.J_t / dm.m * state["beta_rate"] ** 2
    return float((0.5 * bouncing**2).item()), float((0.5 * centre**2 + spin).item())


@claim(
    "4.1",
    "The energy of the normal motion per mass falls with frequency, about as g^2/(8 f^2) (printed as g/(8 f^2))",
    "f^2 E constant to 10 %, and g^2/8 to 20 %; partly: the first. E is that of the bouncing ball per its mass as it leaves "
    "the plate: what leaves with g/(2 f) and falls back to its height lands a period later, and has g^2/(8 f^2)",
)
def energy_and_frequency(lab: Lab) -> Finding:
    energies = []
    for f, beta0 in zip(lab.reached["f"].values, lab.reached["beta0"].values, strict=True):
        run = lab.run(f=float(f), beta0=float(beta0))
        energies.append([8 * f**2 / run.parameters["g"] ** 2 * energy for energy in kinetic_energy(run)])
    ball, whole = np.array(energies).T
    value = (
        f"E is {ball.min():.3f} to {ball.max():.3f} times g^2/(8 f^2), f from 15 to 35 Hz (that of the dimer per its mass "
        f"{whole.min():.3f} to {whole.max():.3f}: B1 has next to none)"
    )
    scales, size = span(ball) < 0.1, abs(ball.mean() - 1) < 0.2
    return found(value, scales and size, partly=scales)


@claim(
    "4.1",
    "The aspect ratio has barely any effect on the excitation of the drift, the dip angle being free (A_r from 4)",
    "some start drifts at every A_r from 4 to 8",
)
def aspect_and_drift(lab: Lab) -> Finding:
    cube = lab.short.isel(Gamma=0)
    share = (runs_of(cube, "drift") / cube["n_runs"]).sel(A_r=slice(3.99, None))
    some = int((share > 0).sum())
    value = f"some start drifts at {some} of {share.size} values; from {100 * share.min():.0f} to {100 * share.max():.0f} % do"
    return found(value, bool((share > 0).all()), partly=bool((share > 0).mean() > 0.9))


@claim(
    "4.1", "The drift is unstable for A_r below 2.5 (experiments it quotes)", "no start drifts below 2.5 (Gamma = 0.9)"
)
def short_dimers(lab: Lab) -> Finding:
    cube = lab.short.isel(Gamma=0)
    some = cube["A_r"].values[runs_of(cube, "drift").values > 0]
    value = f"no start drifts below A_r = {some.min():.2f}" if some.size else "no start drifts at all"
    return found(value, bool(some.size and some.min() >= 2.5))


@claim(
    "4.2",
    "For e in (1/3, 4/5) a narrow range R_1 of Gamma lets the drift start (Fig. 8, Abstract: e and Gamma are critical)",
    "fold and flip are there at every e, with a stable drift at nine tenths of the points between them, and R_1 is at each e "
    "narrower than half of what it spans over all e",
)
def narrow_range(lab: Lab) -> Finding:
    e, low, high = lab.fold["e"].values, lab.fold["Gamma"].values, lab.flip["Gamma"].values
    every = max(1, e.size // 6)
    ranges = "; ".join(f"e = {e[k]:.3g}: {low[k]:.3f} to {high[k]:.3f}" for k in range(0, e.size, every))
    off = [np.abs(x - [ball(k) for k in e]).max() for x, ball in ((low, ball_fold), (high, ball_flip))]
    stable = float(np.mean([orbit is not None for _, _, orbit in lab.inside]))
    value = (
        f"Gamma: {ranges}; within {off[0]:.3f} and {off[1]:.3f} of pi (1 - e)/(1 + e) and its doubling; stable at "
        f"{100 * stable:.0f} % of {len(lab.inside)} points between. Above Gamma = 1.36 p1's hop lasts over half a period, and "
        "`mode` calls the motion otherwise"
    )
    there = bool(np.isfinite(low).all() and np.isfinite(high).all())
    narrow = bool((high - low).max() < 0.5 * (high.max() - low.min()))
    return found(value, there and stable >= 0.9 and narrow, partly=there)


@claim(
    "4.2",
    "Below lies a dead zone R_2, in which the dimer comes to rest from any start",
    "all starts rest at 0.5, 0.9 and 0.99 of Gamma = min(fold, 1), at every e: above 1 the plate throws off what rests on it",
)
def dead_zone(lab: Lab) -> Finding:
    modes = lab.below["mode"].values
    rest = (modes == M_REST).mean()
    top = np.minimum(lab.fold["Gamma"].values, 1.0)
    value = (
        f"{100 * rest:.1f} % of {modes.size} starts rest, below Gamma = {np.nanmax(top):.2f} (e up to 0.517) falling to "
        f"{np.nanmin(top):.2f} (e = 0.8); between 1 and the fold, for smaller e, there is neither drift nor rest"
    )
    others = sorted({MODES[mode] for mode in modes} - {"rest"})
    return found(value, rest == 1.0, partly=rest > 0.9, reason=f"some starts end in {', '.join(others)}")


@claim(
    "4.2",
    "Across the upper boundary of R_1 other modes appear: flutter, period doubling, stochastic motion",
    "each of flutter, period_n, aperiodic is met up to 0.2 above the flip (all starts)",
)
def other_modes(lab: Lab) -> Finding:
    counts = np.bincount(lab.above["mode"].values, minlength=len(MODES))
    shares = dict(zip(MODES, (counts / counts.sum()).tolist(), strict=True))
    value = ", ".join(
        f"{mode} {100 * share:.1f} %" for mode, share in sorted(shares.items(), key=lambda item: -item[1]) if share
    )
    holds = all(shares[mode] > 0 for mode in ("flutter", "period_n", "aperiodic"))
    return found(value, holds, partly=shares["period_n"] > 0)


@claim(
    "4.2",
    "Anywhere in R_1 the double impact comes in the first quadrant of the plate's cycle",
    "phase within 0 to 0.25 at all stable orbits between fold and flip",
)
def quadrant_in_region(lab: Lab) -> Finding:
    phases = np.array([orbit.impact_phase for _, _, orbit in lab.inside if orbit is not None])
    outside = int(((phases <= 0) | (phases >= 0.25)).sum())
    value = (
        f"{outside} of {phases.size} drifts outside; phase {phases.min():.4f} to {phases.max():.4f} of the cycle, as "
        "Gamma cos(phase) = pi (1 - e)/(1 + e) has it, from 0 at the fold on"
    )
    return found(value, outside == 0, partly=outside < 0.02 * phases.size)


@claim(
    "4.2",
    "For given e and Gamma the phase of the double impact barely varies with the other parameters",
    "within 1 % of a cycle over all that the paper varies: A_r 5 to 7, f 15 to 35 Hz, xdot0 0.5 to 2.5 m/s, its two frictions; "
    "partly: 3 %",
)
def phase_elsewhere(lab: Lab) -> Finding:
    cubes = (lab.orbits, lab.slow, lab.frictions)
    phases = np.concatenate([drifting(cube, "impact_phase") for cube in cubes])
    p = lab.base.parameters
    ball = np.arccos(ball_fold(p["e"]) / p["Gamma"]) / (2 * np.pi)
    value = (
        f"{phases.min():.4f} to {phases.max():.4f} ({phases.size} drifts); a ball, in closed form: {ball:.4f} for all"
    )
    return found(value, np.ptp(phases) < 0.01, partly=np.ptp(phases) < 0.03)


@claim(
    "4.3",
    "Friction has little effect on the periodicity of the normal motion, and large ones on the slip (Fig. 9)",
    "both have the plate's period, p2's height and phase change by less than 2 % and 0.5 % of a cycle, and the slip of p1 "
    "in contact by more than a factor of 2; partly: 5 % and 1 %",
)
def friction_and_normal(lab: Lab) -> Finding:
    both = (lab.base, lab.low)
    tops = [float(run.states(cycle_times(run))["gap_2"].max()) for run in both]
    phases = [drift_orbit(run).impact_phase for run in both]
    slips = [float(np.sqrt(np.nanmean((slip_of_p1(run) ** 2).sum(axis=0)))) for run in both]
    value = (
        f"p2 rises {1e3 * tops[0]:.3f}, {1e3 * tops[1]:.3f} mm, lands at {phases[0]:.5f}, {phases[1]:.5f} of the cycle; "
        f"p1 slips by {1e3 * slips[0]:.2f}, {1e3 * slips[1]:.1f} mm/s (rms)"
    )
    height, phase, slips_more = abs(tops[1] / tops[0] - 1), abs(phases[1] - phases[0]), slips[1] > 2 * slips[0]
    reason = f"the period is the plate's in both, but the height changes by {100 * height:.1f} % and the phase by {phase:.4f}"
    return found(
        value, height < 0.02 and phase < 0.005 and slips_more, partly=height < 0.05 and phase < 0.01, reason=reason
    )


@claim(
    "4.3",
    "With mu = 0.05, mu_s = 0.1 the impact ends in DI(sp,sp) and the orbit is an inward spiral (Fig. 10)",
    "end of the impact and sign of the change of R",
)
def inward_spiral(lab: Lab) -> Finding:
    orbit = drift_orbit(lab.low)
    turn = orbit.radius_drift * orbit.period * lab.low.parameters["f"]
    value = f"{last_double_impact(lab.low)[-1]}; radius {orbit.radius:.3f} m, {1e3 * turn:+.2f} mm a turn"
    return found(value, orbit.di_end == "sp_sp" and turn < 0)


@claim(
    "4.3",
    "In the spiral both the precession rate and the speed fall, the speed faster",
    "both fall, the speed by the larger share",
)
def spiral_slows(lab: Lab) -> Finding:
    orbit = drift_orbit(lab.low)
    speed, rate = orbit.speed_drift / orbit.speed, orbit.precession_rate_drift / orbit.precession_rate
    return found(f"{speed:.3e} and {rate:.3e} a period (speed, precession rate)", speed < rate < 0)


@claim(
    "4.3",
    "A circular orbit is formed only if the double impact ends in DI(sp,sk) or DI(sk,sk); DI(sp,sp) gives a spiral",
    "DI(sp,sp) changes the radius more than five times as fast as the others (medians over A_r 4 to 7, mu, mu_s)",
)
def circle_or_spiral(lab: Lab) -> Finding:
    cube = lab.friction
    change = abs(cube["growth"] * cube["period"] * lab.base.parameters["f"])
    middle = {end: float(change.where(cube["di_end"] == end).median()) for end in ("sp_sp", "sp_sk", "sk_sk")}
    value = ", ".join(f"{end} {100 * share:.4f} %" for end, share in middle.items()) + " of R a turn"
    reason = (
        "p1 slips on in its lasting contact whatever the impact ends in, and its friction there moves the spin and with it "
        f"R: by {100 * middle['sp_sk']:.3f} % a turn after DI(sp,sk) too"
    )
    known = [share for end, share in middle.items() if end != "sp_sp" and np.isfinite(share)]
    return found(value, middle["sp_sp"] > 5 * max(known), reason=reason)


@claim(
    "4.3",
    "Outward spirals do not appear",
    "no orbit grows by over 1e-6 of R a period (Fig. 10 shrinks by 1.7e-6), over A_r 5 to 7, f, xdot0, mu, mu_s; partly: "
    "under 5 % do",
)
def no_outward_spiral(lab: Lab) -> Finding:
    change, losing = [], []
    for cube in (lab.orbits, lab.slow, lab.friction.sel(A_r=[5, 6, 7])):
        known = (cube["mode"].values == M_DRIFT) & np.isfinite(cube["growth"].values)
        change.extend(cube["growth"].values[known])
        losing.extend(cube["spin_drift"].values[known] < 0)
    grows = np.array(change) > NO_GROWTH
    value = f"{grows.sum()} of {grows.size} orbits grow, the fastest by {max(change):.1e} of R a period"
    lose, gain = (int((grows & (np.array(losing) == way)).sum()) for way in (True, False))
    reason = (
        "the two signs in dR/dn = R'(s) ds/dn are not bound to one another: of those that grow "
        f"{lose} lose spin where R'(s) < 0, and {gain} gain spin where R'(s) > 0"
    )
    return found(value, not grows.any(), partly=bool(grows.mean() < 0.05), reason=reason)


@claim("4.3", "DI(sk,sk) barely appears in the 3D drift", "fewer than 5 % of the drifts over A_r 4 to 7, mu, mu_s")
def both_stick(lab: Lab) -> Finding:
    ends = lab.friction["di_end"].where(lab.friction["mode"] == M_DRIFT, "none").values
    share = (ends == "sk_sk").sum() / (ends != "none").sum()
    per_A_r = ", ".join(
        f"A_r = {a:g}: {100 * (row == 'sk_sk').sum() / max(1, (row != 'none').sum()):.0f} %"
        for a, row in zip(lab.friction["A_r"].values, ends, strict=True)
    )
    ratios = ", ".join(f"{stick_ratio(a):.3f}" for a in lab.friction["A_r"].values)
    reason = (
        f"p1 comes to stick beside p2 once friction can stop its axial slip, mu > mubar = |W_an|/W_aa ({ratios} at A_r 4, 5, "
        "6, 7), which the paper's mu = 0.2 exceeds from A_r = 6 on"
    )
    return found(f"{100 * share:.0f} % of the drifts ({per_A_r})", share < 0.05, reason=reason)


@claim(
    "4.3",
    "In the planar dimer a small A_r drifts in positive direction, a large one in negative direction, with DI(sk,sk)",
    "positive for A_r below 6 and negative above 7; partly: negative in DI(sk,sk) for half of those above 7",
)
def planar_direction(lab: Lab) -> Finding:
    cube = lab.planar
    drift = cube["mode"].values == M_DRIFT
    A_r, v = cube["A_r"].values[drift], 1e3 * cube["axial_velocity"].values[drift]
    ends = names(cube["di_end"]).values[drift]
    low, high, back = v[A_r < 6], v[A_r > 7], v < 0
    value = (
        f"A_r below 6: {low.min():+.1f} to {low.max():+.1f} mm/s; above 7: {high.min():+.2f} to {high.max():+.2f} mm/s"
    )
    if back.any():
        value += (
            f"; negative at A_r {A_r[back].min():.2f} to {A_r[back].max():.2f}, in {', '.join(sorted(set(ends[back])))}"
        )
    stuck = (high < 0) & (ends[A_r > 7] == "sk_sk")
    reason = (
        "a dimer that ends in DI(sk,sk) rolls on, and rolling carries it back as far as forth: above A_r = 7 what is left is "
        f"at most {np.abs(high).max():.1f} mm/s, of up to {np.abs(low).max():.0f} mm/s below 6, where those that stick go back"
    )
    holds = bool((high < 0).all() and (low > 0).all())
    return found(value, holds, partly=bool(stuck.mean() >= 0.5), reason=reason)


@claim("4.3", "DI(sp,sk) does not exist in planar motion", "ends of the double impact for xdot0 = 0")
def planar_ends(lab: Lab) -> Finding:
    ends = sorted(set(names(lab.planar["di_end"]).values[lab.planar["mode"].values == M_DRIFT]))
    return found(", ".join(ends), "sp_sk" not in ends)


@claim("4.1", "The drift of the base case is sensitive to the initial dip angle (Abstract)", "more than 4 changes")
def sensitive(lab: Lab) -> Finding:
    modes = lab.dips["mode"].sel(f=15)
    changes = int((np.diff((modes == M_DRIFT).values.astype(int)) != 0).sum())
    rest = float((modes == M_REST).mean())
    value = f"the verdict changes {changes} times between 0 and pi/2 at 15 Hz ({100 * rest:.0f} % of the starts rest)"
    return found(value, changes > 4)
