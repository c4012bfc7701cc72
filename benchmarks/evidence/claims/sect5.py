"""Claims of Sect. 5: the circular orbit, and why its radius differs from the paper's."""

from typing import Any, NamedTuple

import numpy as np
from lab import LOW_FRICTION, Lab, drift_orbit
from ledger import Finding, claim, found
from sect3 import state_shares
from sect4 import drifting, span

from dimersweep import names, search, simulate
from dimersweep.cubes.findings import (
    Minimum,
    PowerLaw,
    exponents,
    minimum,
    stick_ratio,
)
from dimersweep.kernel.model.layout import M_DRIFT

PAPER_RADIUS = 2.4  # m, read by the paper off its Fig. 14 at A_r = 5, f = 15 Hz


@claim(
    "5.1",
    "zeta is in (pi/2, pi) on a circular orbit, and in (0, pi/2] on an inward spiral (Fig. 12)",
    "both as said, for the base case and the small friction",
)
def angles(lab: Lab) -> Finding:
    circle, spiral = drift_orbit(lab.base).zeta, drift_orbit(lab.low).zeta
    value = f"{circle:.4f} rad (base), {spiral:.4f} rad (mu = 0.05, mu_s = 0.1); pi/2 = {np.pi / 2:.4f}"
    return found(value, circle > np.pi / 2 >= spiral)


@claim(
    "5.2",
    "The radius is almost independent of xdot0 between 0.5 and 2.5 (Fig. 13)",
    "varies by less than 5 %; partly: 10 %",
)
def radius_and_velocity(lab: Lab) -> Finding:
    radii = drifting(lab.slow, "radius")
    value = f"{radii.min():.3f} to {radii.max():.3f} m, {100 * span(radii):.1f} % (xdot0 grows by a factor of 5)"
    reason = (
        f"the slower the spin, the more of the cycle p1 slips along the axis: R(s) falls from {radii[0]:.3f} m at 0.5 m/s to "
        f"{radii[-1]:.3f} m at 2.5 m/s along the family"
    )
    return found(value, span(radii) < 0.05, partly=span(radii) < 0.1, reason=reason)


def _exponent_words(law: PowerLaw) -> str:
    return f"{law.exponent:.3f} ± {law.error:.3f} (local slopes {law.least:.2f} to {law.greatest:.2f})"


def _by_aspect(law: PowerLaw, lab: Lab) -> str:
    """Why the exponent of A_r is not 3."""
    ends = lab.orbits["di_end"].sel(f=15).values.tolist()
    return (
        f"the local slope goes from {law.least:.2f} to {law.greatest:.2f}: short dimers, whose impact ends in {ends[0]} at 15 "
        "Hz, slip along the axis for more of the cycle than long ones, which widens their orbits"
    )


def _by_frequency(lab: Lab) -> str:
    """Why the exponent of f is not 2."""
    f, radius = lab.orbits["f"].values, lab.orbits["radius"].sel(A_r=6).values
    slope, offset = np.polyfit(f**2, radius, 1)
    rest = np.abs(radius - offset - slope * f**2).max() / radius.max()
    return (
        f"R = {1e3 * slope:.2f} mm f^2/Hz^2 - {-offset:.2f} m at A_r = 6, to {100 * rest:.1f} % of the greatest: beside f^2 "
        "the constant falls as 1/f^2, as the dip angle does, and the local slope goes towards 2"
    )


@claim(
    "5.2",
    "R is proportional to (A_r - 1)^3 (Fig. 14a, Abstract and Conclusion: closely)",
    "exponent within 5 % of 3 over A_r 5 to 7, f 15 to 35 Hz; partly: 15 %",
)
def radius_by_aspect(lab: Lab) -> Finding:
    law = exponents(lab.orbits, "radius")["A_r"]
    off = abs(law.exponent - 3)
    return found(_exponent_words(law), off < 0.15, partly=off < 0.45, reason=_by_aspect(law, lab))


@claim("5.2", "R is proportional to f^2 (Fig. 14b)", "exponent within 5 % of 2; partly: 10 %")
def radius_by_frequency(lab: Lab) -> Finding:
    law = exponents(lab.orbits, "radius")["f"]
    off = abs(law.exponent - 2)
    return found(_exponent_words(law), off < 0.1, partly=off < 0.2, reason=_by_frequency(lab))


@claim("5.2", "At A_r = 5 and f = 15 Hz the radius is about 2.4 m", "to 2 %; partly: 10 %")
def radius_of_five(lab: Lab) -> Finding:
    at = lab.orbits.sel(A_r=5, f=15)
    radius, change = at["radius"].item(), at["growth"].item() * at["radius"].item()
    off = radius / PAPER_RADIUS - 1
    value = f"{radius:.3f} m ({100 * off:+.0f} %), changing by {change:.0e} m a period"
    reason = (
        "p1 rolls for half of its contact, and R is the larger the less it does: 2.36 m with mu_s = mu, where it never rolls "
        "(see the study below)"
    )
    return found(value, abs(off) < 0.02, partly=abs(off) < 0.1, reason=reason)


@claim(
    "5.2",
    "At mu = 0.2, mu_s = 0.4 the impact ends in DI(sp,sk) for A_r of 4.5 and more",
    "all DI(sp,sk) at f = 15 Hz, A_r 5 to 7; partly: some",
)
def ends_by_aspect(lab: Lab) -> Finding:
    cube = lab.orbits
    ends = cube["di_end"].sel(f=15).values.tolist()
    value = "; ".join(f"A_r = {a:g}: {end}" for a, end in zip(cube["A_r"].values, ends, strict=True))
    ratios = ", ".join(f"{stick_ratio(a):.3f}" for a in (5, 6, 7))
    reason = (
        f"p1, slipping along the axis, can come to rest only where mu exceeds mubar = |W_an|/W_aa ({ratios} at A_r 5, 6, 7): "
        "mu = 0.2 does so from A_r = 6 on, and above it both ends stick"
    )
    return found(value, set(ends) == {"sp_sk"}, partly="sp_sk" in ends, reason=reason)


@claim(
    "5.2",
    "With enough friction the radius is below 0.3 m for A_r = 4, r = 2 mm, l = 12 mm",
    "all below 0.3 m where the impact ends in DI(sp,sk) or DI(sk,sk), mu 0.4 to 0.8, mu_s = 0.8; partly: some",
)
def small_dimer(lab: Lab) -> Finding:
    cube = lab.small_dimer
    ends = names(cube["di_end"])
    kept = (cube["mode"] == M_DRIFT) & ends.isin(["sp_sk", "sk_sk"])
    radii = cube["radius"].values[kept.values]
    if not radii.size:
        return found("no drift that ends in DI(sp,sk) was found", False)
    value = f"{radii.min():.3f} to {radii.max():.3f} m at {radii.size} of {kept.size} points, f = 15 and 20 Hz"
    return found(value, radii.max() < 0.3, partly=radii.min() < 0.3)


@claim(
    "5.2",
    "The period scales like the radius, as (A_r - 1)^3 and f^2 (Fig. 15)",
    "both exponents within 5 %; partly: 15 % and 10 %",
)
def period_laws(lab: Lab) -> Finding:
    laws = exponents(lab.orbits, "period")
    off = [abs(laws["A_r"].exponent - 3), abs(laws["f"].exponent - 2)]
    value = f"A_r: {_exponent_words(laws['A_r'])}; f: {_exponent_words(laws['f'])}"
    reason = f"T = 2 pi R/v at one v, and R is not as said: {_by_frequency(lab)}"
    if off[0] >= 0.15:
        reason += f", and over A_r {_by_aspect(laws['A_r'], lab)}"
    return found(value, off[0] < 0.15 and off[1] < 0.1, partly=off[0] < 0.45 and off[1] < 0.2, reason=reason)


@claim("5.2", "The speed is independent of A_r and f", "varies by less than 5 %; partly: 10 %")
def speed_constant(lab: Lab) -> Finding:
    speeds = drifting(lab.orbits, "speed")
    value = f"{speeds.min():.4f} to {speeds.max():.4f} m/s, {100 * span(speeds):.1f} %: r times the spin, which the start sets"
    return found(value, span(speeds) < 0.05, partly=span(speeds) < 0.1)


@claim(
    "5.2",
    "zeta falls a little and monotonically towards pi/2 as A_r or f rises (Fig. 16)",
    "falls in every step of both; partly: in f, and all within 0.05 rad",
)
def angle_trends(lab: Lab) -> Finding:
    zeta = lab.orbits["zeta"].where(lab.orbits["mode"] == M_DRIFT)
    by_f = bool((zeta.diff("f") < 0).all())
    falls = float((zeta.diff("A_r") < 0).mean())
    little = float(zeta.max() - zeta.min())
    at15 = ", ".join(f"{z:.4f}" for z in zeta.sel(f=15).values[:: max(1, (zeta.sizes["A_r"] - 1) // 2)])
    value = (
        f"over f it falls {'always' if by_f else 'not always'}, over A_r in {100 * falls:.0f} % of the steps "
        f"({at15} from A_r 5 to 7 at 15 Hz); all within {little:.3f} rad"
    )
    reason = (
        f"over A_r it rises up to about 6, where mubar = {stick_ratio(6):.3f} falls below mu and the impact ends in a stick in "
        "place of DI(sp,sp), and falls from there"
    )
    return found(value, by_f and falls == 1, partly=by_f and little < 0.05, reason=reason)


def _minima(lab: Lab) -> dict[float, Minimum]:
    cube = lab.fast
    period = cube["period"].where(cube["mode"] == M_DRIFT)
    return {float(a): minimum(cube["xdot0"].values, period.sel(A_r=a).values) for a in cube["A_r"].values}


@claim(
    "5.2",
    "For a given A_r the period has a minimum over xdot0 (Fig. 17, Abstract of Sect. 1)",
    "a minimum within 0.5 to 9 m/s for each A_r, read from runs; partly: for some",
)
def period_has_minimum(lab: Lab) -> Finding:
    minima = _minima(lab)
    value = "; ".join(f"A_r = {a:g}: {low.words('s', 'm/s')}" for a, low in minima.items())
    value += f" (after {int(lab.fast['n_periods'].max())} periods, from the least dip angle that drifts)"
    there = [low.located and 0.5 < low.at < 9 for low in minima.values()]
    reason = (
        "where none is located the spin has forgotten the start: friction takes spin from fast starts and gives it to slow "
        "ones, so that all come near the one spin at which ds/dn = 0, with one period"
    )
    return found(value, all(there), partly=any(there), reason=reason)


@claim("5.2", "At that minimum zeta is close to pi/2", "within 0.02 rad at each A_r; partly: where there is a minimum")
def angle_at_minimum(lab: Lab) -> Finding:
    cube = lab.fast
    off = {}
    for a, low in _minima(lab).items():
        zeta = cube["zeta"].sel(A_r=a).values
        known = np.isfinite(zeta)
        off[a] = float(np.interp(low.at, cube["xdot0"].values[known], zeta[known])) - np.pi / 2
    offsets = {a: "no minimum located" if np.isnan(gap) else f"pi/2 {gap:+.4f}" for a, gap in off.items()}
    value = ", ".join(f"A_r = {a:g}: {words}" for a, words in offsets.items())
    located = [gap for gap in off.values() if np.isfinite(gap)]
    close = bool(located) and all(abs(gap) < 0.02 for gap in located)
    return found(
        value, close and len(located) == len(off), partly=close, reason="it is, but for where no minimum is located"
    )


@claim(
    "5.2",
    "Gamma, e and the friction have little effect on R, T and zeta, once a circular orbit is formed",
    "R and T vary by less than 10 % with each of Gamma 0.85 to 1.15, e 0.58 to 0.7, mu 0.05 to 0.5 (A_r = 6); partly: 30 %",
)
def other_parameters(lab: Lab) -> Finding:
    friction = lab.friction.sel(A_r=6)
    friction = friction.where(friction["di_end"].isin(["sp_sk", "sk_sk"]))
    changes, spans = [], []
    for word, cube in (("Gamma", lab.intensity), ("e", lab.restitution), ("mu, mu_s", friction)):
        of = {name: span(drifting(cube, name)) for name in ("radius", "period", "zeta")}
        spans.append(max(of["radius"], of["period"]))
        changes.append(
            f"{word}: R {100 * of['radius']:.0f} %, T {100 * of['period']:.0f} %, zeta {100 * of['zeta']:.1f} %"
        )
    radius, over = lab.intensity["radius"].values, lab.orbits["radius"]
    reason = (
        f"R falls from {np.nanmax(radius):.2f} to {np.nanmin(radius):.2f} m over Gamma, the impact coming later in the cycle, "
        f"little beside the factor of {float(over.max() / over.min()):.0f} over A_r and f, but more than 10 %"
    )
    return found("; ".join(changes), max(spans) < 0.1, partly=max(spans) < 0.3, reason=reason)


STUDY: tuple[tuple[str, dict[str, Any]], ...] = (
    ("the paper's values", {}),
    ("stick friction as slip friction, mu_s = mu = 0.2", {"mu_s": 0.2}),
    ("held by mu in lasting contact, mu_h = mu = 0.2", {"mu_h": 0.2}),
    ("mu_s = 0.3", {"mu_s": 0.3}),
    ("less friction, mu = 0.05, mu_s = 0.1", LOW_FRICTION),
    ("mu = mu_s = 0.15", {"mu": 0.15, "mu_s": 0.15}),
    ("mu = mu_s = 0.1", {"mu": 0.1, "mu_s": 0.1}),
    ("mu = 0.1, mu_s = 0.2", {"mu": 0.1, "mu_s": 0.2}),
    ("more friction, mu = 0.3, mu_s = 0.6", {"mu": 0.3, "mu_s": 0.6}),
    ("less restitution at p1, e_1 = 0.3, e_2 = 0.6", {"e_1": 0.3, "e_2": 0.6}),
    ("e = 0.65", {"e": 0.65}),
    ("Gamma = 0.85", {"Gamma": 0.85}),
    ("Gamma = 1", {"Gamma": 1.0}),
    ("slower start, xdot0 = 0.5", {"xdot0": 0.5}),
    ("faster start, xdot0 = 2", {"xdot0": 2.0}),
    ("a rod without mass", {"rho_r": 0.0}),
    ("a solid rod of steel", {"rho_r": 7850.0}),
    ("g = 10", {"g": 10.0}),
    ("f = 15.6 Hz", {"f": 15.6}),
    ("A_r = 5.15", {"A_r": 5.15}),
)


class Studied(NamedTuple):
    """Radius [m], end of the double impact, share of the cycle that p1 rolls, initial dip angle [deg]."""

    radius: float
    end: str
    rolls: float
    beta0: float


def radius_study(lab: Lab) -> list[str]:
    """The radius at A_r = 5, f = 15 Hz under varied modelling choices, as lines of Markdown."""
    lines = [
        "## What would make the radius 2.4 m",
        "",
        f"The radius at A_r = 5, f = 15 Hz after {lab.late} periods, one thing changed at a time; each from the least initial",
        "dip angle that drifts. The share of the cycle that p1 rolls (SC_sk) says how it is held between the impacts.",
        "",
        "| changed | R [m] | against 2.4 m | impact ends | p1 rolls | beta0 [deg] |",
        "|---|---|---|---|---|---|",
    ]
    rows = [(word, changed, _studied(lab, changed)) for word, changed in STUDY]
    for word, _, studied in rows:
        if studied is None:
            lines.append(f"| {word} | no drift | | | | |")
            continue
        radius, end, rolls, beta0 = studied
        off = f"{100 * (radius / PAPER_RADIUS - 1):+.1f} %"
        lines.append(f"| {word} | {radius:.3f} | {off} | {end} | {100 * rolls:.0f} % | {beta0:.1f} |")
    return [*lines, "", *_conclusion([(changed, studied) for _, changed, studied in rows if studied is not None])]


def _conclusion(rows: list[tuple[dict[str, Any], Studied]]) -> list[str]:
    """What the variants of friction say, by how much of the cycle p1 rolls in them."""
    friction = [studied for changed, studied in rows if set(changed) <= {"mu", "mu_s", "mu_h"}]
    slips = [one.radius for one in friction if one.rolls < 0.2]
    rolls = [one.radius for one in friction if one.rolls >= 0.2]
    return [
        f"Where friction alone is changed, R is {min(slips):.2f} to {max(slips):.2f} m if p1 slips through its contact",
        f"(it rolls for less than 20 % of the cycle) and {min(rolls):.2f} to {max(rolls):.2f} m if it rolls for longer. The",
        "paper gives that contact state as SC_sp, slip, all along (Sect. 3.1), and its radius is one of slip all along; at its",
        "own mu = 0.2, mu_s = 0.4 Coulomb's law, Eq. (4), makes p1 roll once its slip has died out. A frequency or an aspect",
        "ratio misread by 3 to 4 % would do as well; what else is varied moves the radius the other way, or too little.",
    ]


def _studied(lab: Lab, changed: dict[str, Any]) -> Studied | None:
    """The orbit at A_r = 5, f = 15 Hz with some parameters changed; None without a drift."""
    given: dict[str, Any] = {"A_r": 5.0} | changed
    f = given.pop("f", 15.0)
    how: dict[str, Any] = {"periods": 300, "workers": 1, "progress": False}
    cube = search({"f": [f], "beta0": lab.starts}, given, over="beta0", ask="first", **how)
    if cube["mode"].item() != M_DRIFT:
        return None
    run = simulate(**(given | {"f": f, "beta0": cube["beta0"].item()}), periods=lab.late)
    if not run.orbit:
        return None
    rolls = state_shares(run).get("SC1_sk", 0.0)
    return Studied(run.orbit.radius, run.orbit.di_end, rolls, float(np.rad2deg(cube["beta0"].item())))
