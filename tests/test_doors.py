"""Numbers come in by one door: every public argument takes a record with its units, or refuses it in a line that names it."""

import inspect
import re
from datetime import timedelta
from decimal import Decimal
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.figure import Figure

import dimersweep
from dimersweep import fits, names, orbits, plots
from dimersweep.analysis.borders.border_files import read_borders
from dimersweep.analysis.fits.measured import MEASURABLE
from dimersweep.cubes.grid import axis_values, make_grid
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, as_numbers
from dimersweep.runs.accessor import DatasetAccessor
from dimersweep.symbols import PARAMETERS
from dimersweep.work.options import make_options
from tests.checks.public import keywords

TIMES = np.arange(1500) / 1000
SHAKEN = -9.81 * (0.9 * np.sin(2 * np.pi * 15 * TIMES) + 0.05 * np.sin(4 * np.pi * 15 * TIMES + 1))
SHAKEN += np.random.default_rng(1).normal(0, 0.01, TIMES.size)
TURNS = np.linspace(0, 10, 30)
X, Y = np.cos(TURNS) + 3, np.sin(TURNS)
SEEN = {"path_radius": (4.06, 0.02)}
FREE = {"e": (0.55, 0.75)}
LOOSE = {"rtol": 1e-8}
AT_104 = {"spin": 104.0, **LOOSE}
IN_STATES = {"periods": 2, "progress": False}


def in_unit(values, unit):
    """A number or a column of xarray with its unit."""
    return xr.DataArray(values, dims=("n",) * np.ndim(values), attrs={"units": unit})


def said(table):
    """All numbers of a dataset, but for what counts the work."""
    return np.concatenate([np.ravel(v.values) for v in table.variables.values() if v.dtype.kind == "f"])


def orbit_numbers(orbit):
    return [orbit.spin, orbit.radius, orbit.parameters["e"], orbit.parameters["f"]]


def likelihood_numbers(one):
    return [*one.low, *one.high, *one.measured.values, *one.measured.errors, one.spin or 0, *one.fixed.values()]


def waves(found):
    return [found.f, *(number for wave in found.waves.values() for pair in wave.values() for number in pair)]


def track(found):
    return [*found.values.values(), found.sigma]


def drawn(call):
    """What a picture of a run shows: the ends of its first line."""
    axes = Figure().subplots()
    call(axes)
    return axes.lines[0].get_xydata()[[0, -1]]


@pytest.fixture(scope="module")
def made():
    """Runs, orbits and tables that others begin with."""
    orbit = orbits.find(**AT_104)
    return {
        "orbit": orbit,
        "run": dimersweep.simulate(periods=60),
        "family": orbits.family(spin=(100.0, 104.0), points=5, **LOOSE),
        "likelihood": fits.Likelihood(SEEN, FREE, rtol=1e-6),
        "cube": dimersweep.sweep({"r": [4e-3, 5e-3]}, **IN_STATES),
        "carried": dimersweep.sweep({"Gamma": [0.6, 0.9]}, carry="both", **IN_STATES),
    }


# of each argument that takes numbers: a call with it, and what a plain number gives it, in which unit
DOORS = {
    "circle.t": (lambda v, _: track(fits.circle(v, X, Y)), TURNS, "s"),
    "circle.x": (lambda v, _: track(fits.circle(TURNS, v, Y)), X, "m"),
    "circle.y": (lambda v, _: track(fits.circle(TURNS, X, v)), Y, "m"),
    "circle.sigma": (lambda v, _: track(fits.circle(TURNS, X, Y, v)), 0.01, "m"),
    "cycloid.t": (lambda v, _: track(fits.cycloid(v, X, Y)), TURNS, "s"),
    "cycloid.x": (lambda v, _: track(fits.cycloid(TURNS, v, Y)), X, "m"),
    "cycloid.y": (lambda v, _: track(fits.cycloid(TURNS, X, v)), Y, "m"),
    "cycloid.sigma": (lambda v, _: track(fits.cycloid(TURNS, X, Y, v)), 0.01, "m"),
    "Waveform.fit.t": (lambda v, _: waves(fits.Waveform.fit(v, SHAKEN)), TIMES, "s"),
    "Waveform.fit.a": (lambda v, _: waves(fits.Waveform.fit(TIMES, v)), SHAKEN, "m s-2"),
    "Waveform.fit.f": (lambda v, _: waves(fits.Waveform.fit(TIMES, SHAKEN, v)), 15.0, "Hz"),
    "Waveform.fit.g": (lambda v, _: waves(fits.Waveform.fit(TIMES, SHAKEN, g=v)), 9.7, "m s-2"),
    "Waveform.acceleration.cycles": (
        lambda v, _: fits.Waveform(15.0, {"z": {1: (0.9, 0.0)}}).acceleration(v), np.array([0.1, 0.2]), "1"
    ),
    "Measured.values": (lambda v, _: fits.Measured(("path_radius",), v, [[0.01]]).values, np.array([4.0]), "m"),
    "Measured.covariance": (
        lambda v, _: fits.Measured(("path_radius", "period"), [4.0, 30.0], v).errors, np.diag([0.01, 0.04]), "1"
    ),
    "Measured.of.measured": (lambda v, _: fits.Measured.of({"path_radius": (v, 0.1)}).values, 4.0, "m"),
    "Measured.also.measured": (
        lambda v, _: fits.Measured.of(SEEN).also(zeta=(v, 0.1)).values, 1.6, "rad"
    ),
    "Likelihood.measured": (
        lambda v, _: likelihood_numbers(fits.Likelihood({"path_radius": (4.06, v)}, FREE)), 0.02, "m"
    ),
    "Likelihood.free": (lambda v, _: likelihood_numbers(fits.Likelihood(SEEN, {"beta0": (0.1, v)})), 0.2, "rad"),
    "Likelihood.spin": (lambda v, _: likelihood_numbers(fits.Likelihood(SEEN, FREE, spin=v)), 104.0, "rad s-1"),
    "Likelihood.parameters": (lambda v, _: likelihood_numbers(fits.Likelihood(SEEN, FREE, f=v)), 16.0, "Hz"),
    "Likelihood.rtol": (lambda v, _: fits.Likelihood(SEEN, FREE, rtol=v).rtol, 1e-8, "1"),
    "fit.measured": (lambda v, _: list(fits.fit({"path_radius": (4.06, v)}, FREE, rtol=1e-6).errors.values()), 0.02, "m"),
    "fit.free": (lambda v, _: fits.fit(SEEN, {"spin": (v, 110.0)}, rtol=1e-6).ranges["spin"], 100.0, "rad s-1"),
    "fit.spin": (lambda v, _: fits.fit(SEEN, FREE, spin=v, rtol=1e-6).values["e"], 104.0, "rad s-1"),
    "fit.parameters": (lambda v, _: fits.fit(SEEN, FREE, r=v, rtol=1e-6).values["e"], 5.05e-3, "m"),
    "fit.rtol": (lambda v, _: fits.fit(SEEN, FREE, rtol=v).values["e"], 1e-6, "1"),
    "Likelihood.point": (lambda v, made: made["likelihood"](v), np.array([0.65]), "1"),
    "find.spin": (lambda v, _: orbit_numbers(orbits.find(spin=v, **LOOSE)), 104.0, "rad s-1"),
    "find.parameters": (lambda v, _: orbit_numbers(orbits.find(f=v, **AT_104)), 15.0, "Hz"),
    "find.rtol": (lambda v, _: orbits.find(spin=104.0, rtol=v).rtol, 1e-8, "1"),
    "later.spin": (lambda v, made: orbits.later(made["family"], spin=v, periods=10)[:2], 102.0, "rad s-1"),
    "later.periods": (lambda v, made: orbits.later(made["family"], spin=102.0, periods=v)[:2], 10.0, "1"),
    "later.seconds": (lambda v, made: orbits.later(made["family"], spin=102.0, seconds=v)[:2], 0.7, "s"),
    "centre_drift.spin": (lambda v, _: orbits.centre_drift(tilt=1e-3, spin=v, **LOOSE)[1:], 104.0, "rad s-1"),
    "centre_drift.parameters": (lambda v, _: orbits.centre_drift(tilt=v, **AT_104)[1:], 1e-3, "rad"),
    "centre_drift.rtol": (lambda v, _: orbits.centre_drift(tilt=1e-3, spin=104.0, rtol=v)[1:], 1e-8, "1"),
    "family.spin": (lambda v, _: said(orbits.family(spin=(100.0, v), points=2, **LOOSE)), 101.0, "rad s-1"),
    "family.parameters": (lambda v, _: said(orbits.family(spin=(100.0, 101.0), points=2, f=v, **LOOSE)), 15.0, "Hz"),
    "family.rtol": (lambda v, _: said(orbits.family(spin=(100.0, 101.0), points=2, rtol=v)), 1e-8, "1"),
    "border.over": (lambda v, _: said(orbits.border("fold", "Gamma", {"f": [v]}, **AT_104)), 15.0, "Hz"),
    "border.spin": (lambda v, _: said(orbits.border("fold", "Gamma", {"e": [0.6]}, spin=v, **LOOSE)), 104.0, "rad s-1"),
    "border.fixed": (lambda v, _: said(orbits.border("fold", "Gamma", {"e": [0.6]}, r=v, **AT_104)), 5e-3, "m"),
    "border.rtol": (lambda v, _: said(orbits.border("fold", "Gamma", {"e": [0.6]}, spin=104.0, rtol=v)), 1e-8, "1"),
    "border_curve.span": (lambda v, _: said(curve("f", (v, 15.1))), 15.0, "Hz"),
    "border_curve.spin": (lambda v, _: said(curve("e", (0.6, 0.61), spin=v)), 104.0, "rad s-1"),
    "border_curve.fixed": (lambda v, _: said(curve("e", (0.6, 0.61), r=v)), 5e-3, "m"),
    "border_curve.rtol": (lambda v, _: said(curve("e", (0.6, 0.61), rtol=v)), 1e-8, "1"),
    "follow.to": (lambda v, made: said(orbits.follow(made["orbit"], "f", to=v, points=2)), 15.01, "Hz"),
    "sustained.spin": (lambda v, _: said(orbits.sustained(spin=(100.0, v), **LOOSE)), 101.0, "rad s-1"),
    "sustained.parameters": (lambda v, _: said(orbits.sustained(spin=(100.0, 101.0), r=v, **LOOSE)), 5e-3, "m"),
    "sustained.rtol": (lambda v, _: said(orbits.sustained(spin=(100.0, 101.0), rtol=v)), 1e-8, "1"),
    "edge.between": (lambda v, _: edge(between=(v, 0.25)), 0.24, "rad"),
    "edge.within": (lambda v, _: edge(within=v), 0.02, "rad"),
    "edge.parameters": (lambda v, _: edge(f=v), 15.0, "Hz"),
    "edge.rtol": (lambda v, _: edge(rtol=v), 1e-5, "1"),
    "Parameters.given": (lambda v, _: dimersweep.Parameters(r=v).r, 4e-3, "m"),
    "simulate.start": (lambda v, _: run_numbers(start={"beta": v}), 0.3, "rad"),
    "simulate.rtol": (lambda v, _: run_numbers(rtol=v), 1e-9, "1"),
    "simulate.max_seconds": (lambda v, _: run_numbers(max_seconds=v), 100.0, "s"),
    "sweep.give_up_after": (lambda v, _: make_options(give_up_after=v).give_up_after, 100.0, "s"),
    "Run.states.t": (lambda v, made: said(made["run"].states(v)), np.array([0.5, 1.0]), "s"),
    "Run.error.t": (lambda v, made: made["run"].error(v)["time"].values, np.array([0.51]), "s"),
    "Run.section.phase": (lambda v, made: said(made["run"].section(phase=v)), 1.0, "rad"),
    "Run.animate.speed": (lambda v, made: made["run"].animate("a.gif", speed=v, fps=1, periods=1, force=True).stat().st_size,
                          1.0, "1"),
    "PeriodicOrbit.run.rtol": (lambda v, made: made["orbit"].run(2, rtol=v).rtol, 1e-7, "1"),
    "sweep.grid": (lambda v, _: grid_of(dimersweep.sweep({"r": [v, 6e-3]}, **IN_STATES)), 5e-3, "m"),
    "sweep.fixed": (lambda v, _: grid_of(dimersweep.sweep({"r": [5e-3]}, {"f": v}, **IN_STATES)), 16.0, "Hz"),
    "sweep.points": (
        lambda v, _: grid_of(dimersweep.sweep(points={"r": v}, **IN_STATES)), np.array([5e-3, 6e-3]), "m"
    ),
    "sweep.rtol": (lambda v, _: dimersweep.sweep({"r": [5e-3]}, rtol=v, **IN_STATES)["rtol"].values, 1e-7, "1"),
    "loops.within": (lambda v, made: said(dimersweep.loops(made["carried"], within=v)), 0.1, "1"),
    "attractors.ranges": (lambda v, _: census({"beta0": (v, 0.3)}), 0.2, "rad"),
    "attractors.fixed": (lambda v, _: census(fixed={"f": v}), 16.0, "Hz"),
    "attractors.points": (lambda v, _: census(None, points={"beta0": v}), np.array([0.2, 0.3]), "rad"),
    "attractors.over": (lambda v, _: census(over={"f": [v]}), 15.0, "Hz"),
    "attractors.level": (lambda v, _: census(level=v), 0.9, "1"),
    "attractors.rtol": (lambda v, _: census(rtol=v), 1e-7, "1"),
    "DatasetAccessor.at.where": (lambda v, made: made["cube"].dimersweep.at(r=v)["r"].values, 4e-3, "m"),
    "DatasetAccessor.run.where": (lambda v, made: made["cube"].dimersweep.run(r=v).parameters["r"], 4e-3, "m"),
    "circle_through.x": (lambda v, _: dimersweep.circle_through(v, Y), X, "m"),
    "circle_through.y": (lambda v, _: dimersweep.circle_through(X, v), Y, "m"),
    **{
        f"stick_ratio.{name}": (lambda v, _, name=name: dimersweep.stick_ratio(**{"A_r": 6, name: v}), value, unit)
        for name, value, unit in (
            ("A_r", 6.0, "1"), ("r", 4e-3, "m"), ("rho_b", 7e3, "kg m-3"), ("rho_r", 1e3, "kg m-3"), ("D_r", 3e-3, "m"))
    },
    "heights.span": (lambda v, made: drawn(lambda axes: plots.heights(axes, made["run"], (v, 3.2))), 3.0, "s"),
    "portrait.span": (lambda v, made: drawn(lambda axes: plots.portrait(axes, made["run"], "beta", (v, 3.2))), 3.0, "s"),
}  # fmt: skip
# made like another one, by the same functions
ALIKE = {
    "Likelihood.orbit.point", "Likelihood.values.point",
    *(f"{name}.{each}" for name in ("search", "refine", "bifurcation") for each in ("grid", "fixed", "points", "rtol")),
    "make.rtol", "simulate.parameters", "impact_rates.time",  # see below
    *(f"{name}.give_up_after" for name in ("search", "refine", "bifurcation", "make")),
}  # fmt: skip
# whole numbers and switches, which have no unit: each has a test of its own refusals
COUNTS = {
    "periods", "max_periods", "points", "starts", "seed", "confirm", "strobes", "workers", "fps", "dpi", "orbit_periods",
    "halvings", "part", "parts", "arrows", "paths", "fewest",
}  # fmt: skip
# what takes no number, or is made by the package and not by a user
NO_NUMBERS = {
    "Run", "PeriodicOrbit", "Orbit", "Edge", "Fit", "Track", "Lyapunov", "Multipliers", "Spectrum", "Minimum", "PowerLaw",
    "Waveform.f", "Waveform.waves", "Waveform.errors", "Waveform.rest", "Waveform.spectrum",
    "Waveform.others", "Waveform.notes", "observer.version", "observer.depends",  # these `simulate` reads
    "Measured.names", "Measured.track", "qr_growth.maps", "qr_growth.directions",
    # whose units it keeps, see below
    "minimum.points", "minimum.values",
}  # fmt: skip
WORDS = {
    "path", "force", "look", "cube", "run", "orbit", "guess", "recorder", "kind", "parameter", "other", "axis", "axes", "name",
    "mode", "ask", "over", "between", "observe", "client", "extend", "out", "keep_tiles", "progress", "retry", "fail_fast",
    "attrs", "carry", "certify", "sustained", "stop_when_settled", "record", "switch", "sequences", "mirror", "slow", "last",
    "slow_impacts", "tex", "always", "wanted", "by", "at", "color", "angle", "quantity", "region", "figure", "how", "unit",
    "at_unit", "flags", "variables", "declared", "data", "family", "start", "columns", "observe_with", "port", "measured",
    "finish",
}  # fmt: skip


def curve(other, span, **how):
    how = {"spin": 104.0, "rtol": 1e-8, "points": 1} | how
    return orbits.border_curve("fold", "Gamma", other, span=span, **how)


def edge(**how):
    """The ends of a range in which a run rests, as they are told; no edge is looked for."""
    how = {"between": (0.24, 0.25), "periods": 60, "rtol": 1e-5} | how
    try:
        return orbits.edge("beta0", how.pop("between"), **how)
    except ParameterError as told:
        if "both lead to rest" not in str(told):
            raise
        return [float(each) for each in re.findall(r"0\.\d+", str(told))]


def run_numbers(**how):
    run = dimersweep.simulate(periods=2, **how)
    return [run.rtol, run.n_events, *said(run.states(run.duration))]


def grid_of(cube):
    return np.concatenate([np.ravel(cube[name].values) for name in ("r", "f", "speed")])


def census(ranges={"beta0": (0.2, 0.3)}, **how):  # noqa: B006 - nobody changes it
    found = dimersweep.attractors(ranges, starts=2, periods=4, progress=False, **how)
    return np.concatenate(
        [np.ravel(found[name].values) for name in ("beta0", "share_low", "cost", *how.get("over", ())) if name in found]
    )


def public_arguments():
    """Every argument of every public function and method, as function.argument."""
    for module in (dimersweep, orbits, fits, plots):
        for name in module.__all__:
            yield from arguments_of(name, getattr(module, name))
    yield from arguments_of("DatasetAccessor", DatasetAccessor)


def arguments_of(name, one):
    if inspect.isclass(one) and not issubclass(one, BaseException):
        for called, defined in vars(one).items():
            method = getattr(defined, "__func__", defined)
            if inspect.isfunction(method) and (not called.startswith("_") or called in ("__init__", "__call__")):
                inner = name if called in ("__init__", "__call__") else f"{name}.{called}"
                yield from (
                    f"{inner}.{each}" for each in inspect.signature(method).parameters if each not in ("self", "cls")
                )
    elif inspect.isfunction(one):
        more = keywords(one) if "look" not in inspect.signature(one).parameters else []
        yield from (f"{name}.{each}" for each in (*inspect.signature(one).parameters, *more) if each != "options")


def test_every_public_argument_that_takes_numbers_stands_here():
    parameters = {f"simulate.{name}" for name in keywords(dimersweep.simulate)} - set(DOORS)
    found = set(public_arguments()) - parameters
    unknown = {
        each
        for each in found - set(DOORS) - ALIKE
        if each not in NO_NUMBERS
        and each.partition(".")[0] not in NO_NUMBERS
        and each.rpartition(".")[2] not in WORDS | COUNTS
    }
    assert unknown == set()
    assert set(DOORS) - found - parameters == set()  # none of them is gone


SLOW = ("fit", "centre_drift", "border_curve", "border")  # which are asked once in another unit
OTHER = {
    "m": ("mm", 1e3), "s": ("ms", 1e3), "rad": ("deg", 180 / np.pi), "Hz": ("rpm", 60.0), "rad s-1": ("rpm", 30 / np.pi),
    "m s-2": ("g", 1 / 9.80665), "kg m-3": ("g/cm3", 1e-3), "1": ("%", 100.0),
}  # fmt: skip


@pytest.mark.parametrize("door", DOORS)
def test_a_unit_is_converted_and_what_cannot_be_is_refused_in_a_line(door, made, empty_folder):
    call, value, units = DOORS[door]
    plain = call(value, made)
    unit, factor = OTHER[units]
    scaled = np.asarray(value) * factor
    many = bool(np.ndim(value))
    numbers = (
        in_unit(scaled, unit) if np.ndim(value) < 2 else xr.DataArray(scaled, dims=("i", "j"), attrs={"units": unit})
    )
    np.testing.assert_allclose(call(numbers, made), plain, rtol=1e-6, atol=1e-9)
    texts = (
        [f"{each!r} {unit}" for each in scaled.tolist()]
        if np.ndim(value) == 1
        else f"{float(np.ravel(scaled)[0])!r} {unit}"
    )
    if np.ndim(value) < 2 and door.partition(".")[0] not in SLOW:
        np.testing.assert_allclose(call(texts, made), plain, rtol=1e-6, atol=1e-9)
    masked = np.ma.array(value, mask=np.zeros(np.shape(value), bool))
    masked[(0,) * np.ndim(value)] = np.ma.masked
    first = np.array(value, float)
    first[(0,) * np.ndim(value)] = np.nan
    wrong = {"another kind": numbers.assign_attrs(units="K"), "a mask": masked, "nan": first if many else float("nan")}
    if door == "Likelihood.point":  # a sampler may ask for anything
        assert call(masked, made) == call(first, made) == -np.inf
        del wrong["a mask"], wrong["nan"]
    for kind, each in wrong.items():
        with pytest.raises(ParameterError) as refused:
            call(each, made)
        told = str(refused.value)
        names = {door.rpartition(".")[2], "a", "error", "measured", "start", *PARAMETERS, *MEASURABLE}
        assert "\n" not in told and re.match(r"\w+", told)[0] in names, (kind, told)


def test_the_time_of_an_impact_may_carry_its_unit(made):
    run = made["run"]
    time = run.events["time"][names(run.events["kind"]).str.startswith("DI")][-1]
    assert plots.impact_rates(run, time).equals(plots.impact_rates(run, float(time)))
    with pytest.raises(ParameterError, match=r"^time = .*has the unit K"):
        plots.impact_rates(run, time.assign_attrs(units="K"))


# --- the door itself ------------------------------------------------------------------------------------------------------

SPELT = {
    "m": {"500um": 5e-4, "500 µm": 5e-4, "500 \u03bcm": 5e-4, "3cm": 0.03, "4.1 mm": 4.1e-3, "1e-3 km": 1,
          "2 millimeters": 2e-3},
    "s": {"5 min": 300, "20 ms": 0.02, "20 us": 2e-5, "1 hour": 3600, "3 h": 10_800, "3 seconds": 3, "0.5 d": 43_200,
          "2 days": 172_800},
    "m s-2": {
        "1 g": 9.80665, "1 G": 9.80665, "20 mg": 0.1961330, "9.81 m/s2": 9.81, "9.81 m/s^2": 9.81, "9.81 m s-2": 9.81,
        "9.81 m s^-2": 9.81, "9.81 m/s²": 9.81, "9.81 m s⁻²": 9.81, "981 cm/s**2": 9.81, "9.81 m/s/s": 9.81, "1 gn": 9.80665,
    },
    "rad": {"16 deg": 4 * np.pi / 45, "16°": 4 * np.pi / 45, "16 degrees": 4 * np.pi / 45, "2 mrad": 2e-3, "1 turn": 2 * np.pi},
    "rad s-1": {"1000 rpm": 100 * np.pi / 3, "1000 r/min": 100 * np.pi / 3, "90 deg/s": np.pi / 2, "2 turns/s": 4 * np.pi,
                "3 rad/s": 3},
    "Hz": {"900 rpm": 15, "900 1/min": 15, "900 min-1": 15, "0.015 kHz": 15, "15 s-1": 15, "30 Hz": 30, "15 rev/s": 15},
    "m s-1": {"5 mm/s": 5e-3, "5 cm s-1": 0.05, "−5 mm/s": -5e-3, "3.6 km/h": 1.0, "1 meter per second": 1},
    "kg m-3": {"7.85 g/cm3": 7850, "7850 kg/m^3": 7850, "1.18 g cm-3": 1180},
    "1": {"60 %": 0.6, "0.6": 0.6},
}  # fmt: skip


@pytest.mark.parametrize(("units", "text", "value"), [(u, t, v) for u, rows in SPELT.items() for t, v in rows.items()])
def test_a_unit_may_be_spelt_in_all_usual_ways(units, text, value):
    assert as_number("x", text, units) == pytest.approx(value, rel=1e-14)
    assert as_number("x", text.replace(" ", "\N{NO-BREAK SPACE}"), units) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("units", "text"),
    [
        ("m", "5 K"), ("m", "5 kg"), ("m", "5 m2"), ("m", "5 mm/s"), ("m", "5 Pm m"), ("m s-2", "5 kg"), ("m s-2", "1 m/s"),
        ("rad s-1", "15 Hz"), ("rad s-1", "15 1/s"), ("rad", "16 degC"), ("rad", "5 %"), ("1", "5 deg"), ("1", "5 mm"),
        ("Hz", "15 rad"), ("Hz", "5 s"), ("s", "5 MS"), ("s", "seconds since 2024-01-01"), ("kg m-3", "7.85 g/cm2"),
        ("s", "5 m s"),
    ],
)  # fmt: skip
def test_another_kind_of_unit_is_refused(units, text):
    with pytest.raises(ParameterError, match=r"^x = .*: (the unit )?must be "):
        as_number("x", text, units)


def test_4_1_mm_is_the_float_that_0_0041_is():
    assert as_number("r", "4.1 mm", "m") == as_number("r", in_unit(4.1, "mm"), "m") == 0.0041


CARRIED = {
    "a column of pandas": pd.Series([1.0, 2.0]),
    "texts": ["1 m", "200 cm"],
    "texts of pandas": pd.Series(["1000 mm", "2 m"]),
    "decimal numbers": [Decimal(1), Fraction(2)],
    "objects": np.array([Decimal(1), Fraction(2)], dtype=object),
    "of one number each": [np.array(1), in_unit(2e3, "mm")],
    "a variable of xarray": in_unit([1e3, 2e3], "mm").variable,
    "an attribute in bytes": in_unit([1e3, 2e3], b"mm"),
    "dask": in_unit([1e3, 2e3], "mm").chunk(),
    "masked, without a gap": np.ma.array([1, 2]),
    "a range": range(1, 3),
}


@pytest.mark.parametrize("kind", CARRIED)
def test_numbers_come_in_whatever_carries_them(kind):
    assert as_numbers("x", CARRIED[kind], "m").tolist() == [1, 2]


class Quantity:
    """An array with a unit of its own, as those of pint and astropy are: numpy takes its numbers and forgets the unit."""

    def __init__(self, numbers, unit):
        self.magnitude, self.units = np.asarray(numbers), unit
        self.ndim = self.magnitude.ndim

    def __array__(self, dtype=None, copy=None):
        pytest.fail("the unit is lost")


class Unit:
    """A unit of a library."""

    def __init__(self, text):
        self.text = text

    def __str__(self):
        return self.text


@pytest.mark.parametrize(
    ("unit", "units", "factor"),
    [
        ("millimeter", "m", 1e-3), ("meter / second ** 2", "m s-2", 1), ("standard_gravity", "m s-2", 9.80665),
        ("revolutions_per_minute", "Hz", 1 / 60), ("1 / minute", "Hz", 1 / 60), ("m / s2", "m s-2", 1), ("um", "m", 1e-6),
        ("degree / second", "rad s-1", np.pi / 180), ("", "1", 1), ("dimensionless", "1", 1),
    ],
)  # fmt: skip
def test_units_of_libraries_are_read_as_they_write_them(unit, units, factor):
    assert as_numbers("x", Quantity([1.0, 2.0], Unit(unit)), units) == pytest.approx([factor, 2 * factor])
    assert as_number("x", Quantity(3.0, Unit(unit)), units) == pytest.approx(3 * factor)


@pytest.mark.parametrize(("unit", "units"), [("g", "m s-2"), ("gram", "m s-2"), ("", "m"), ("degree_Celsius", "rad")])
def test_units_of_libraries_of_another_kind_are_refused(unit, units):
    with pytest.raises(ParameterError, match=rf"^x = .*has the unit {unit}; the unit must be "):
        as_numbers("x", Quantity([1.0], Unit(unit)), units)


DURATIONS = {
    "numpy": np.timedelta64(1500, "ms"), "Python": timedelta(seconds=1.5), "pandas": pd.Timedelta("1.5s"),
}  # fmt: skip


@pytest.mark.parametrize("kind", DURATIONS)
def test_a_duration_is_in_seconds(kind):
    assert as_number("t", DURATIONS[kind], "s") == 1.5
    with pytest.raises(ParameterError, match=r"^x = .*the unit must be m, mm or the like"):
        as_number("x", DURATIONS[kind], "m")


def test_a_column_of_durations_is_in_seconds_and_dates_are_refused():
    later = pd.to_timedelta([0, 1500], unit="ms")
    for each in (later, pd.Series(later), later.to_numpy(), xr.DataArray(later)):
        assert as_numbers("t", each, "s").tolist() == [0, 1.5]
    dates = pd.Timestamp("2024-01-01") + later
    with pytest.raises(ParameterError, match=r"^t = .*must be a number; of dates give the time since one of them$"):
        as_numbers("t", dates, "s")


# --- columns that belong together -------------------------------------------------------------------------------------------


def test_columns_whose_labels_differ_are_refused():
    t, x, y = (pd.Series(each) for each in (TURNS, X, Y))
    assert track(fits.circle(t, x, y)) == track(fits.circle(TURNS, X, Y))
    shuffled = y.sample(frac=1, random_state=1)
    for columns in ((t, x, shuffled), (TURNS, x, shuffled), (t, x.set_axis(TURNS), y)):
        with pytest.raises(
            ParameterError, match=r"^[xy]: has other labels than [tx]; align them, or give both without$"
        ):
            fits.circle(*columns)
    by_time = pd.Series(Y, index=TURNS)
    assert track(fits.circle(by_time.index, X, by_time)) == track(fits.circle(TURNS, X, Y))
    with pytest.raises(ParameterError, match=r"^y: has other labels than t"):
        fits.circle(by_time.index[::-1], X, by_time)
    labelled = [xr.DataArray(each, coords={"time": TURNS}, dims="time") for each in (TURNS, X, Y)]
    with pytest.raises(ParameterError, match=r"^y: has other labels than t"):
        fits.circle(*labelled[:2], labelled[2].isel(time=slice(None, None, -1)))
    with pytest.raises(ParameterError, match=r"^a .z.: has other labels than t"):
        fits.Waveform.fit(pd.Series(TIMES), pd.Series(SHAKEN, index=TIMES))
    with pytest.raises(ParameterError, match=r"^f: has other labels than r"):
        dimersweep.sweep(points={"r": pd.Series([4e-3, 5e-3]), "f": pd.Series([15, 20], index=[1, 0])}, **IN_STATES)


COLUMNS = {
    "names": (["t", "z", "x"], "t", None),
    "numbers": ([0, 1, 2], 0, {"z": 1, "x": 2}),
    "pairs": (
        pd.MultiIndex.from_tuples([("t", "s"), ("a", "z"), ("a", "x")]),
        ("t", "s"),
        {"z": ("a", "z"), "x": ("a", "x")},
    ),
}


@pytest.mark.parametrize("kind", COLUMNS)
def test_columns_of_a_record_may_have_any_labels(kind):
    labels, t, axes = COLUMNS[kind]
    table = pd.DataFrame(np.column_stack([TIMES, SHAKEN, 0.1 * SHAKEN]), columns=labels)
    found = fits.Waveform.fit(t, table, axes=axes)
    assert waves(found) == waves(fits.Waveform.fit(TIMES, np.column_stack([SHAKEN, 0.1 * SHAKEN]), axes=["z", "x"]))
    with pytest.raises(ParameterError, match=r"^a: has no column seven"):
        fits.Waveform.fit(t, table, axes={"z": "seven"})


def test_a_record_in_g_and_in_milliseconds_is_that_of_the_shaker():
    record = xr.Dataset(
        {"z": ("time", SHAKEN / 9.80665, {"units": "g"})}, {"time": ("time", 1e3 * TIMES, {"units": "ms"})}
    )
    found = fits.Waveform.fit("time", record)
    assert (found.f, found.waves["z"][1][0]) == (pytest.approx(15, abs=1e-3), pytest.approx(0.9, abs=1e-3))


# --- what an observer returns ---------------------------------------------------------------------------------------------


RETURNED = SimpleNamespace()  # a namespace, whose content is no part of what the observer is


@dimersweep.observer(
    height={"units": "m", "long_name": "a height"},
    row={"units": "s", "long_name": "some times", "along": {"name": "entry", "values": 2}},
)
def given_back(_):
    """What a test wants."""
    return RETURNED.values


OF_OBSERVERS = {
    "masked": ({"height": np.ma.masked, "row": np.ma.array([1.0, 2.0], mask=[False, True])}, (np.nan, [1, np.nan])),
    "units": ({"height": in_unit(5.0, "mm"), "row": in_unit([1.0, 2.0], "ms")}, (5e-3, [1e-3, 2e-3])),
    "durations": ({"row": np.array([1500, 2000], "m8[ms]"), "height": "3 cm"}, (0.03, [1.5, 2])),
    "in a list": ({"row": [np.timedelta64(5, "ms"), np.ma.masked], "height": True}, (1, [5e-3, np.nan])),
    "plain": ({"row": [np.inf, np.nan], "height": -np.inf}, (-np.inf, [np.inf, np.nan])),
}


@pytest.mark.parametrize("kind", OF_OBSERVERS)
def test_what_an_observer_returns_keeps_its_unit_and_its_gaps(kind):
    returned, (height, row) = OF_OBSERVERS[kind]
    RETURNED.values = returned
    cube = dimersweep.sweep({"Gamma": [0.9]}, observe=given_back, **IN_STATES)
    assert cube["observer_error"].values.tolist() == [""]
    np.testing.assert_array_equal(cube["height"].values, [height])
    np.testing.assert_array_equal(cube["row"].values, [row])


@pytest.mark.parametrize("value", [in_unit(5.0, "K"), np.timedelta64(5, "s"), np.datetime64(5, "s"), "tall"])
def test_what_an_observer_returns_in_another_kind_of_unit_is_its_error(value):
    RETURNED.values = {"height": value}
    cube = dimersweep.sweep({"Gamma": [0.9]}, observe=given_back, **IN_STATES)
    assert "height = " in str(cube["observer_error"].values[0]) and np.isnan(cube["height"].values[0])


# --- what is given in place of parameters ----------------------------------------------------------------------------------


def test_a_fit_takes_what_stands_for_parameters():
    gamma = 1e-3 * (30 * np.pi) ** 2 / 9.81
    made = fits.Likelihood(SEEN, FREE, A_z="1 mm", l="5 cm", r="4 mm")
    assert made.fixed == pytest.approx({"Gamma": gamma, "A_r": 7.25, "r": 4e-3})
    made = fits.Likelihood(SEEN, FREE, harmonics={"f": "900 rpm", "z": {1: (0.9, 0), 2: (0.02, "90 deg")}})
    assert made.fixed == pytest.approx({"f": 15} | {"Gamma": 0.9, "Gamma_2": 0.02, "phi_2": np.pi / 2} | made.fixed)
    for free, more, told in (
        ({"f": (14, 16)}, {"A_z": 1e-3}, "A_z: takes one f, which varies here; give Gamma"),
        ({"r": (4e-3, 5e-3)}, {"l": 0.05}, "l: takes one r, which varies here; give A_r"),
        ({"Gamma": (0.8, 1)}, {"A_z": 1e-3}, "Gamma: is given and free; leave one of the two out"),
        ({"A_z": (1e-3, 2e-3)}, {}, r"A_z: is for single runs and fixed values \(amplitude"),
    ):
        with pytest.raises(ParameterError, match=f"^{told}"):
            fits.Likelihood(SEEN, free, **more)


def test_borders_and_edges_take_what_stands_for_parameters_where_it_stays_one_value():
    how = {"over": {"e": [0.6]}, **AT_104}
    plain = orbits.border("fold", "Gamma", A_r=7.25, r=4e-3, **how)
    assert said(orbits.border("fold", "Gamma", l="5 cm", r="4 mm", **how)) == pytest.approx(said(plain), rel=1e-6)
    for call in (
        lambda: orbits.border("fold", "Gamma", {"r": ["4 mm", "5 mm"]}, l="5 cm", **AT_104),
        lambda: orbits.border_curve("fold", "Gamma", "r", span=("4 mm", "5 mm"), l="5 cm", **AT_104),
        lambda: orbits.edge("r", ("4 mm", "5 mm"), l="5 cm"),
    ):
        with pytest.raises(ParameterError, match=r"^l: takes one r, which varies here; give A_r$"):
            call()
    with pytest.raises(ParameterError, match=r"^A_z: is for single runs and fixed values \(amplitude"):
        orbits.edge("A_z", ("1 mm", "2 mm"))
    waves = {"z": {1: (0.9, 0)}, "x": {1: (1e-3, 0)}}
    assert orbits.centre_drift(harmonics=waves, **AT_104)[1:] == orbits.centre_drift(Gamma_x=1e-3, **AT_104)[1:]


FILE = """
[borders]
title = "a"
output = "b.nc"
[branches]
parameter = "r"
ends = [{}]
spin = {}
[fixed]
{}
"""


def test_a_file_of_borders_takes_units_and_what_stands_for_parameters(empty_folder):
    told = {}
    for name, filling in {
        "plain": ("0.0041", "104.71975511965977", "Gamma = 0.9054682936779225\nf = 15\nmu_s = 0.4"),
        "units": ('"4.1 mm"', '"1000 rpm"', 'A_z = "1 mm"\nf = "900 rpm"\nmu_s = { value = 40, unit = "%" }'),
    }.items():
        (empty_folder / "borders.toml").write_text(FILE.format(*filling))
        told[name] = read_borders("borders.toml").configuration
    assert told["units"]["branches"] == told["plain"]["branches"]
    assert told["units"]["fixed"] == pytest.approx(told["plain"]["fixed"], rel=1e-6)


def test_steps_of_an_axis_are_taken_in_the_unit_of_its_texts():
    axis = axis_values("r", {"start": "1 mm", "stop": "2 mm", "step": "0.1 mm"})
    assert axis.tolist() == pytest.approx(np.arange(10, 21) / 1e4, rel=1e-15)
    assert axis_values("beta0", {"start": 0, "stop": "10 deg", "step": "5 deg"}) == pytest.approx(
        np.radians([0, 5, 10])
    )
    assert axis_values("f", {"start": "900 rpm", "stop": 20, "num": 2}).tolist() == [15, 20]


SIZES = {
    "r": (4.0, "r = 4: at most 0.1 m is usual; is it in SI units?"),
    "r_2": (4.0, "r_2 = 4: at most 0.1 m is usual; is it in SI units?"),
    "Gamma": (60.0, "Gamma = 60: at most 50 is usual; is it in SI units?"),
    "rho_b": (7.85, "rho_b = 7.85: 100 to 30000 kg m-3 is usual; is it in SI units?"),
    "l": (50.0, "A_r = 5001: at most 100 is usual; is it in SI units?"),
}


@pytest.mark.parametrize("name", SIZES)
def test_a_size_that_is_most_likely_in_another_unit_is_told(name):
    value, told = SIZES[name]
    with pytest.warns(RuntimeWarning) as warned:
        assert dimersweep.Parameters(**{name: value})
    assert [str(each.message) for each in warned] == [told]
    if name != "l":
        with pytest.warns(RuntimeWarning, match=re.escape(told)):
            axis = make_grid({name: [value, 1.1 * value]}).axes[name]
        assert axis[0] == value
