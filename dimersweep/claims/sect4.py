"""Claims of Sect. 4: what excites the drift, and what friction does to it."""

import numpy as np
import xarray as xr

from dimersweep.claims.lab import Lab, orbit_of
from dimersweep.claims.ledger import Finding, claim, verdict
from dimersweep.claims.sect3 import double_impact, last_cycle
from dimersweep.cubes.cube import names
from dimersweep.cubes.reading import drift_intervals, drift_lengths, runs_of
from dimersweep.kernel.model.layout import M_DRIFT, M_REST, MODES
from dimersweep.runs.run import Run
from dimersweep.runs.simulating import simulate


def drifting(cube: xr.Dataset, name: str) -> np.ndarray:
    """The values of a quantity where a run of the cube drifts."""
    values = cube[name].values[cube["mode"].values == M_DRIFT]
    return values[np.isfinite(values)]


def span(values: np.ndarray) -> float:
    """Greatest less least value, over their mean."""
    return float(np.ptp(values) / np.abs(values.mean()))


@claim("4.1", "The initial velocity has no effect on the formation of the drift (xdot0 from 0.5 to 2.5)")
def velocity_and_drift(lab: Lab) -> Finding:
    drift = (lab.speeds["mode"] == M_DRIFT).values
    differ = (drift != drift[1]).any(axis=0).mean()
    per_row = ", ".join(f"{100 * share:.1f} %" for share in drift.mean(axis=1))
    value = f"{100 * differ:.1f} % of the starts change their verdict with xdot0; drift from {per_row} of them"
    return Finding(value, verdict(differ == 0, differ < 0.1), "no start changes; partly: fewer than 10 % do")


@claim("4.1", "The intervals of initial dip angles that drift get denser as the frequency rises (Fig. 7)")
def denser_intervals(lab: Lab) -> Finding:
    counts = [len(intervals) for intervals in drift_intervals(lab.dips)]
    value = f"{counts[0]}, {counts[1]}, {counts[2]} intervals at 15, 20, 25 Hz"
    return Finding(value, verdict(counts[0] < counts[1] < counts[2]), "their number rises with f")


@claim("4.1", "The total length of these intervals varies little with the frequency")
def interval_lengths(lab: Lab) -> Finding:
    lengths = drift_lengths(lab.dips).values
    step = float(np.diff(lab.dips["beta0"].values)[0])
    error = step * np.sqrt(np.mean([len(intervals) for intervals in drift_intervals(lab.dips)]) / 3)
    value = f"{lengths[0]:.3f}, {lengths[1]:.3f}, {lengths[2]:.3f} rad (each ± {error:.3f} by the grid)"
    return Finding(
        value,
        verdict(span(lengths) < 0.15, span(lengths) < 0.3),
        "they differ by less than 15 % of their mean; partly: 30 %",
    )


def normal_energy(run: Run) -> float:
    """Energy per mass of the normal motion after the double impact, from that of the level dimer at rest [m2 s-2]."""
    p = run.parameters
    state = run.states(last_cycle(run)[[1]])
    half = p["r"] * (p["A_r"] - 1)
    rate = state["z1_rate"] + half * np.cos(state["beta"]) * state["beta_rate"]
    ball, rod = 4 / 3 * np.pi * p["r"] ** 3 * p["rho_b"], np.pi / 4 * p["D_r"] ** 2 * 2 * (half - p["r"]) * p["rho_r"]
    inertia = 2 * ball * (2 / 5 * p["r"] ** 2 + half**2) + rod * ((half - p["r"]) ** 2 / 3 + p["D_r"] ** 2 / 16)
    spin = 0.5 * inertia / (2 * ball + rod) * state["beta_rate"] ** 2
    return float((0.5 * rate**2 + spin + p["g"] * (state["z"] - p["r"])).item())


@claim(
    "4.1", "The energy of the normal motion per mass falls with frequency, about as g^2/(8 f^2) (printed as g/(8 f^2))"
)
def energy_and_frequency(lab: Lab) -> Finding:
    starts = {
        float(f): float(b) for f, b in zip(lab.orbits["f"].values, lab.orbits["beta0"].sel(A_r=6).values, strict=True)
    }
    ratios = []
    for f, beta0 in starts.items():
        run = simulate(f=f, beta0=beta0, periods=lab.late)
        ratios.append(normal_energy(run) * 8 * f**2 / run.parameters["g"] ** 2)
    spread, mean = span(np.array(ratios)), sum(ratios) / len(ratios)
    value = (
        f"E is {min(ratios):.3f} to {max(ratios):.3f} times g^2/(8 f^2), f from {min(starts):g} to {max(starts):g} Hz"
    )
    scales, size = spread < 0.1, abs(mean - 1) < 0.2
    why = "f^2 E constant to 10 %, and g^2/8 to 20 %; partly: the first. Right after the double impact, from the level dimer"
    return Finding(value, verdict(scales and size, scales), why)


@claim(
    "4.1",
    "The aspect ratio has barely any effect on the excitation of the drift, the dip angle being free (A_r from 4)",
)
def aspect_and_drift(lab: Lab) -> Finding:
    cube = lab.short.isel(Gamma=0)
    share = (runs_of(cube, "drift") / cube["n_runs"]).sel(A_r=slice(3.99, None))
    some = int((share > 0).sum())
    value = f"some start drifts at {some} of {share.size} values; from {100 * share.min():.0f} to {100 * share.max():.0f} % do"
    return Finding(
        value,
        verdict(bool((share > 0).all()), bool((share > 0).mean() > 0.9)),
        "some start drifts at every A_r from 4 to 8",
    )


@claim("4.1", "The drift is unstable for A_r below 2.5 (experiments it quotes)")
def short_dimers(lab: Lab) -> Finding:
    cube = lab.short.isel(Gamma=0)
    some = cube["A_r"].values[runs_of(cube, "drift").values > 0]
    value = f"no start drifts below A_r = {some.min():.2f} (Gamma = 0.9)" if some.size else "no start drifts at all"
    return Finding(
        value, verdict(some.size > 0 and some.min() >= 2.5), "no drift below 2.5; where it sets in depends on Gamma"
    )


@claim(
    "4.2",
    "For e in (1/3, 4/5) a narrow range R_1 of Gamma lets the drift start (Fig. 8, Abstract: e and Gamma are critical)",
)
def narrow_range(lab: Lab) -> Finding:
    inside = names(lab.plane["region"]) == "drift"
    widths = (inside.sum("Gamma") * np.diff(lab.plane["Gamma"].values)[0]).values
    lowest = inside["Gamma"].where(inside).min("Gamma").values
    value = "; ".join(
        f"e = {e:.2f}: " + (f"{low:.2f} to {low + width:.2f}" if width else "none")
        for e, low, width in zip(lab.plane["e"].values, lowest, widths, strict=True)
    )
    why = "R_1 is met at every e of the grid, and is narrower than half of the range 0.4 to 1.6"
    return Finding(
        f"Gamma: {value}",
        verdict(bool((widths > 0).all() and (widths < 0.6).all()), bool((widths > 0).mean() > 0.5)),
        why,
    )


@claim("4.2", "Below lies a dead zone R_2, in which the dimer comes to rest from any start")
def dead_zone(lab: Lab) -> Finding:
    region = names(lab.plane["region"])
    rest = region == "rest"
    under = rest.isel(Gamma=0)
    top = rest["Gamma"].where(rest).max("Gamma")
    reached = ("none" if np.isnan(g) else f"up to {g:.2f}" for g in top.values)
    value = "; ".join(f"e = {e:.2f}: {told}" for e, told in zip(lab.plane["e"].values, reached, strict=True))
    clean = ((region["Gamma"] > top) | rest).all()
    return Finding(
        value,
        verdict(bool(under.all() and clean), bool(under.mean() > 0.5)),
        "R_2 reaches from Gamma = 0.4 up, without a hole, at every e",
    )


@claim("4.2", "Across the upper boundary of R_1 other modes appear: flutter, period doubling, stochastic motion")
def other_modes(lab: Lab) -> Finding:
    inside = names(lab.plane["region"]) == "drift"
    top = inside["Gamma"].where(inside).max("Gamma")
    runs = lab.plane["runs"].where(lab.plane["Gamma"] > top).sum(("e", "Gamma"))
    shares = dict(zip(MODES, (runs / runs.sum()).values.tolist(), strict=True))
    value = ", ".join(
        f"{mode} {100 * share:.1f} %" for mode, share in sorted(shares.items(), key=lambda item: -item[1]) if share
    )
    holds = all(shares[mode] > 0 for mode in ("flutter", "period_n", "aperiodic"))
    why = "each of flutter, period_n, aperiodic is met among the runs above R_1 (all starts, at the points computed)"
    return Finding(value, verdict(holds, shares["aperiodic"] > 0), why)


@claim("4.2", "Anywhere in R_1 the double impact comes in the first quadrant of the plate's cycle")
def quadrant_in_region(lab: Lab) -> Finding:
    phases = drifting(lab.plane, "impact_phase")
    outside = int(((phases <= 0) | (phases >= 0.25)).sum())
    value = f"{outside} of {phases.size} drifts outside; phase {phases.min():.4f} to {phases.max():.4f} of the cycle"
    return Finding(value, verdict(outside == 0, outside < 0.02 * phases.size), "all within 0 to 0.25")


@claim("4.2", "For given e and Gamma the phase of the double impact barely varies with the other parameters")
def phase_elsewhere(lab: Lab) -> Finding:
    phases = np.concatenate([drifting(cube, "impact_phase") for cube in (lab.orbits, lab.slow, lab.friction)])
    value = f"{phases.min():.4f} to {phases.max():.4f} over A_r, f, xdot0, mu, mu_s ({phases.size} drifts)"
    return Finding(value, verdict(np.ptp(phases) < 0.01, np.ptp(phases) < 0.03), "within 1 % of a cycle; partly: 3 %")


@claim("4.3", "Friction has little effect on the periodicity of the normal motion, and large ones on the slip (Fig. 9)")
def friction_and_normal(lab: Lab) -> Finding:
    tops = [float(run.states(last_cycle(run))["gap_2"].max()) for run in (lab.base, lab.low)]
    phases = [orbit_of(run).impact_phase for run in (lab.base, lab.low)]
    value = (
        f"p2 rises {1e3 * tops[0]:.3f}, {1e3 * tops[1]:.3f} mm, lands at {phases[0]:.5f}, {phases[1]:.5f} of the cycle"
    )
    holds = abs(tops[1] / tops[0] - 1) < 0.02 and abs(phases[1] - phases[0]) < 0.005
    close = abs(tops[1] / tops[0] - 1) < 0.05 and abs(phases[1] - phases[0]) < 0.01
    why = "height to 2 % and phase to 0.005 of a cycle; partly: 5 % and 0.01. Both motions have the period of the plate"
    return Finding(value, verdict(holds, close), why)


@claim("4.3", "With mu = 0.05, mu_s = 0.1 the impact ends in DI(sp,sp) and the orbit is an inward spiral (Fig. 10)")
def inward_spiral(lab: Lab) -> Finding:
    orbit = orbit_of(lab.low)
    turn = orbit.radius_drift * orbit.period * lab.low.parameters["f"]
    value = f"{double_impact(lab.low)[-1]}; radius {orbit.radius:.3f} m, {1e3 * turn:+.2f} mm a turn"
    return Finding(
        value, verdict(orbit.di_end == "sp_sp" and turn < 0), "end of the impact and sign of the change of R"
    )


@claim("4.3", "In the spiral both the precession rate and the speed fall, the speed faster")
def spiral_slows(lab: Lab) -> Finding:
    orbit = orbit_of(lab.low)
    speed, rate = orbit.speed_drift / orbit.speed, orbit.precession_rate_drift / orbit.precession_rate
    value = f"{speed:.3e} and {rate:.3e} a period (speed, precession rate)"
    return Finding(value, verdict(speed < rate < 0), "both fall, the speed by the larger share")


@claim(
    "4.3",
    "A circular orbit is formed only if the double impact ends in DI(sp,sk) or DI(sk,sk); DI(sp,sp) gives a spiral",
)
def circle_or_spiral(lab: Lab) -> Finding:
    cube = lab.friction
    change = abs(cube["radius_drift"] * cube["period"] * cube["f"] / cube["radius"])
    ends = names(cube["di_end"])
    found = {end: change.where((ends == end) & (cube["mode"] == M_DRIFT)) for end in ("sp_sp", "sp_sk", "sk_sk")}
    middle = {end: float(values.median()) for end, values in found.items()}
    value = ", ".join(f"{end} {100 * share:.3f} %" for end, share in middle.items()) + " of R a turn (medians)"
    holds = middle["sp_sp"] > 5 * max(middle["sp_sk"], middle["sk_sk"])
    return Finding(value, verdict(holds), "DI(sp,sp) changes the radius more than five times as fast as the others")


@claim("4.3", "Outward spirals do not appear")
def no_outward_spiral(lab: Lab) -> Finding:
    change, ends = [], []
    for cube in (lab.friction, lab.orbits, lab.slow):
        drift = (cube["mode"] == M_DRIFT).values
        change.extend((cube["radius_drift"] / cube["radius"]).values[drift])
        ends.extend(names(cube["di_end"]).values[drift])
    grows = np.array(change) > 1e-6
    value = f"{grows.sum()} of {grows.size} orbits grow by over 1e-6 of R a period, the fastest by {max(change):.1e}"
    words, counts = np.unique(np.array(ends)[grows], return_counts=True)
    told = ", ".join(f"{word} {count}" for word, count in zip(words, counts, strict=True))
    why = f"none grows; partly: fewer than 5 %. How the double impact of those that grow ends: {told or 'none grows'}"
    return Finding(value, verdict(not grows.any(), bool(grows.mean() < 0.05)), why)


@claim("4.3", "DI(sk,sk) barely appears in the 3D drift")
def both_stick(lab: Lab) -> Finding:
    ends = names(lab.friction["di_end"]).where(lab.friction["mode"] == M_DRIFT, "none").values
    share = (ends == "sk_sk").sum() / (ends != "none").sum()
    per_A_r = ", ".join(
        f"A_r = {a:g}: {100 * (row == 'sk_sk').sum() / max(1, (row != 'none').sum()):.0f} %"
        for a, row in zip(lab.friction["A_r"].values, ends, strict=True)
    )
    why = (
        "fewer than 5 % of the drifts over mu, mu_s. Slip below 1e-7 g/omega counts as none; both ends can come to rest "
        "where mu > mubar, and the longer the dimer, the less friction that takes"
    )
    return Finding(f"{100 * share:.0f} % of the drifts ({per_A_r})", verdict(share < 0.05), why)


@claim(
    "4.3",
    "In the planar dimer a small A_r drifts in positive direction, a large one in negative direction, with DI(sk,sk)",
)
def planar_direction(lab: Lab) -> Finding:
    cube = lab.planar
    drift = cube["mode"].values == M_DRIFT
    A_r, v, ends = (
        cube["A_r"].values[drift],
        1e3 * cube["axial_velocity"].values[drift],
        names(cube["di_end"]).values[drift],
    )
    low, high, back = v[A_r < 6], v[A_r > 7], v < 0
    value = (
        f"A_r below 6: {low.min():+.1f} to {low.max():+.1f} mm/s; above 7: {high.min():+.2f} to {high.max():+.2f} mm/s"
    )
    if back.any():
        value += (
            f"; negative at A_r {A_r[back].min():.2f} to {A_r[back].max():.2f}, in {', '.join(sorted(set(ends[back])))}"
        )
    why = (
        "negative for A_r above 7 and positive below 6. Long dimers end in DI(sk,sk) as the paper says, but then p1 rolls "
        "on for the rest of the cycle, which carries it back as far as forth: they hardly drift"
    )
    return Finding(
        value,
        verdict(bool((high < 0).all() and (low > 0).all()), bool((low > 0).mean() > 0.5 and (high < 0).all())),
        why,
    )


@claim("4.3", "DI(sp,sk) does not exist in planar motion")
def planar_ends(lab: Lab) -> Finding:
    found = sorted(set(names(lab.planar["di_end"]).values[lab.planar["mode"].values == M_DRIFT]))
    return Finding(", ".join(found), verdict("sp_sk" not in found), "ends of the double impact for xdot0 = 0")


@claim("4.1", "The drift of the base case is sensitive to the initial dip angle (Abstract)")
def sensitive(lab: Lab) -> Finding:
    modes = lab.dips["mode"].sel(f=15)
    changes = int((np.diff((modes == M_DRIFT).values.astype(int)) != 0).sum())
    rest = float((modes == M_REST).mean())
    value = f"the verdict changes {changes} times between 0 and pi/2 at 15 Hz ({100 * rest:.0f} % of the starts rest)"
    return Finding(value, verdict(changes > 4), "more than 4 changes")
