"""Attractors of drawn starts: the motions that the starts come to, and the share of the starts of each."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import nan, tau
from operator import attrgetter
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.analysis.attractors.telling_apart import Attractor, Classifier, distance, matched
from dimersweep.analysis.orbits.continuation.following import traced
from dimersweep.analysis.orbits.continuation.kinds import kind_words
from dimersweep.analysis.orbits.map.finding import find
from dimersweep.analysis.orbits.map.orbit import COLUMNS, PeriodicOrbit, multiplier_columns
from dimersweep.analysis.orbits.slow.features import Mirrors, features_of_orbit, mirrors_of
from dimersweep.analysis.orbits.slow.slow_flow import SPIN_KINDS
from dimersweep.analysis.orbits.slow.sustained import MEANINGS
from dimersweep.cubes.cube import Column, column, coordinate, finished, fixed_coordinates, over_grid, table
from dimersweep.cubes.grid import Grid, axis_values, fixed_value, make_points
from dimersweep.cubes.results import Field
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_number, check_count, check_switch
from dimersweep.kernel.model.layout import CODE_N_PERIODS, MODES, WAVES
from dimersweep.parameters import check_level, check_name, moved_on, spelt_out, value_of
from dimersweep.runs.solving import run_settings
from dimersweep.storage.cubefiles import write_cube
from dimersweep.storage.outputs import TABLES, check_output
from dimersweep.storage.provenance import attributes
from dimersweep.studies.making import in_memory
from dimersweep.studies.observers import EndStates, Observer
from dimersweep.studies.observing import own_of
from dimersweep.studies.point_tables import between
from dimersweep.studies.study import Study
from dimersweep.symbols import INSTEAD, PARAMETERS, START, Quantity
from dimersweep.work.computing import prepare_kernel
from dimersweep.work.options import make_options

TITLE = "Attractors and the shares of starts that lead to them"
STARTING = (*START, "phi0")  # parameters that starts are drawn from
NONE = -1  # number of a start where there is none
# flags of the motion after infinite time: kind of the sustained spin, or mode of a motion that leaves its family
FATES = ("none", *SPIN_KINDS, *MODES[1:])
OF_AN_ORBIT = tuple(name for name in COLUMNS if name != "cost")  # columns of an attractor that are numbers of its orbit


def border_between(orbit: PeriodicOrbit, name: str, to: float) -> tuple[float, str]:
    """Return the value of a parameter at which a branch first loses stability or ends, on the way to `to`, and the
    kind.

    The spin is kept. The kind is that of a border of `orbits`, "word" if the orbit leaps to another sequence, or "lost"
    if Newton's method finds no orbit. It is "none", with NaN, if the orbit exists all the way: then only its basin was
    not met. An orbit that comes to repeat after fewer periods has joined the branch of these, at the border where that
    branch loses its stability.
    """
    rows, end, _ = traced(orbit, name, to)
    for there, event in rows:
        if event.kind is not None and not event.kind.of_sequence:
            return event.solution.value, event.kind.name
        shorter = features_of_orbit(there, Mirrors(plane=False, ends=False)).least_period()
        if shorter < orbit.periods:
            return border_between(find(guess=there, periods=shorter), name, value_of(name, orbit.parameters))
    why = end.partition(":")[0]
    return (rows[-1][1].solution.value, why) if why in ("word", "lost") else (float("nan"), "none")


def attractors(
    ranges: Mapping[str, Any] | None = None,
    fixed: Mapping[str, Any] | None = None,
    *,
    points: Any = None,
    starts: int = 1000,
    seed: int = 0,
    over: Mapping[str, Any] | None = None,
    periods: int,
    max_periods: int | None = None,
    rtol: float = 1e-8,
    mirror: bool = True,
    level: float = 0.95,
    confirm: int = 0,
    slow: bool = False,
    observe: Any = None,
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    workers: int | None = None,
    progress: bool = True,
) -> xr.Dataset:
    """Find the attractors of drawn starts, and the share of the starts that comes to each.

    Motions are told apart by their period and by their features at the same spin. The features are the gaps of both
    ends at eight phases of the plate in each period, and the turn of the heading. To compare them, the orbit of one run
    of each motion is found, and followed along its slow family to the spins of the others. Rest, motions that do not
    repeat, and failed runs are one attractor each, by their mode.

    Parameters
    ----------
    ranges : mapping of str to pair, mapping or "any"
        Parameters to draw from, each independently of the others. A pair has the least and the greatest value, such as
        ``{"beta0": ("1 deg", "89 deg")}``; draws are even between them. A value that is met within a tolerance is
        ``{"value": "16 deg", "within": "1 deg"}``, even from 15 to 17 degrees, or normal with a standard deviation:
        ``{"value": "16 deg", "sigma": "1 deg"}``. The phase `phi0` may be "any".
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.
    points : mapping of str to array_like, pandas.DataFrame or xarray.Dataset, optional
        The starts, as columns, in place of ranges.
    starts : int
        Number of starts that are drawn.
    seed : int
        Seed of the draw.
    over : mapping of str to array_like or mapping, optional
        One parameter and its values, as an axis of `sweep`: the same starts are run at each value. Attractors are
        matched from value to value by following their orbits.
    periods, max_periods, rtol
        Settings of the runs, as in `sweep`; a run stops when its motion has settled.
    mirror : bool
        If True, mirror images count as one motion: in the vertical plane of the axis and, where both ends are alike,
        with the ends swapped.
    level : float
        Confidence of the intervals, in (0, 1).
    confirm : int
        If above 0, one run of each attractor is repeated for this number of forcing periods; `confirmed` is True if the
        motion is still the same.
    slow : bool
        If True, starts are told apart by the spin that they come to after infinite time (see `orbits.later`), and not
        by their family.
    observe : callable or str, optional
        An observer of your own, as in `sweep`; its variables lie along `start`.
    out : path-like, optional
        NetCDF file to write the result to.
    force : bool
        If True, an existing file may be replaced.
    workers : int, optional
        Threads; by default one for each core.
    progress : bool
        If True, show finished runs on stderr.

    Returns
    -------
    xarray.Dataset
        Over the values of `over`, if given, and `attractor`, numbered from 1, the most frequent first: `count`, `share`
        [1] and the ends `share_low` and `share_high` of its interval by Wilson's score. The number of a
        `representative` start along `start`; `mode` (not_run where it is not met), `periods` and `word`. `orbit` is
        True if its orbit was found from the end of the representative run; the numbers of this orbit, NaN without one:
        `spin`, `radius`, `period`, `zeta`, `speed`, `multipliers_real` and others. `basin` has the attractor of each
        start. Words are flags (see `names`). With `slow` the orbit is that of the final spin, and `fate`, `spin_low`
        and `spin_high` are `kind` and spins of `orbits.sustained`. `fate` is "kept" where no spin changes, the mode for
        motions that leave the family, and none where it is unknown. With `over`, along `change`: the attractor that
        appears or goes, the values on both sides, and the `border` of its orbit on the way. The attribute `cost` is the
        number of forcing periods of the runs of all starts.

    Raises
    ------
    ParameterError
        For a parameter or a setting that is not allowed, before any work.
    StoreError
        If the file exists or cannot be written, before any work.
    UnfinishedError, Stopped
        As by `sweep`.

    Examples
    --------
    >>> from dimersweep import attractors, names
    >>> found = attractors({"beta0": ("1 deg", "89 deg")}, starts=40, periods=200, progress=False)
    >>> names(found["mode"]).values.tolist()
    ['rest', 'drift']
    >>> release = {"beta0": {"value": "16 deg", "within": "0.5 deg"}, "xdot0": (0.95, 1.05)}
    >>> attractors(release, starts=40, periods=200, progress=False)["share"].values.tolist()
    [1.0]
    """
    out, began = None if out is None else check_output(out, force=force, what="a table", endings=TABLES), perf_counter()
    how = run_settings(periods=periods, max_periods=max_periods, rtol=rtol)
    fixed = _without_phase(fixed, points if ranges is None else ranges)
    columns = drawn_starts(ranges, fixed, points, starts, seed)
    name, values = _axis_of(over, columns)
    mirrored, wanted = check_switch("mirror", mirror), as_number("level", level)
    if not 0 < wanted < 1:
        raise ParameterError(f"level = {wanted:g}: must be in (0, 1)")
    longest = 0 if confirm == 0 else check_count("confirm", confirm)
    table = {key: np.tile(column, values.size) for key, column in columns.items()}
    if name:
        table[name] = np.repeat(values, len(next(iter(columns.values()))))
    drawn = _on_one_plate(make_points(table, fixed), name)
    columns = {key: each[: each.size // values.size] for key, each in drawn.columns.items() if key != name}
    own = own_of(observe, drawn.size, how, others=(EndStates(),), axes=(*drawn.columns, *_NAMES))
    study = Census(
        grid=drawn,
        how=how,
        observers=(EndStates(), *own),
        starts=columns,
        over=name,
        values=values,
        mirror=mirrored,
        level=wanted,
        confirm=longest,
        slow=check_switch("slow", slow),
    )
    prepare_kernel(progress=progress)
    data = study.as_cube(in_memory(study, make_options(workers=workers, progress=progress))[0])
    if out is not None:
        asked = {"periods": periods, "max_periods": max_periods, "rtol": rtol, "mirror": mirrored, "level": wanted}
        write_cube(data.assign_attrs(attributes(asked, TITLE, perf_counter() - began)), out, force=force)
    return data


def drawn_starts(ranges: Any, fixed: Any, points: Any, starts: int, seed: int) -> dict[str, np.ndarray]:
    """Return the columns of starts: of a table, or drawn independently from ranges, whose ends are checked as starts.

    Raises
    ------
    ParameterError
        If there are neither ranges nor points, or both, or one of them is not allowed.
    """
    if (ranges is None) == (points is None):
        raise ParameterError("ranges: give either ranges to draw from or points")
    if points is not None:
        columns = make_points(points).columns
        _check_starts(columns)
        return columns
    if not isinstance(ranges, Mapping) or not ranges:
        raise ParameterError(f"ranges = {ranges!r}: must be a mapping of parameters to pairs such as (0.1, 0.5)")
    _check_starts(ranges)
    count = check_count("starts", starts)
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ParameterError(f"seed = {seed!r}: must be a whole number >= 0")
    spreads, draw = {name: _spread(name, given) for name, given in ranges.items()}, np.random.default_rng(int(seed))
    make_points({name: ends for name, (*ends, _) in spreads.items()}, fixed)
    return {
        name: draw.normal(low, sigma, size=count) if sigma else between(low, high, False, draw.random(count))
        for name, (low, high, sigma) in spreads.items()
    }


def _check_starts(names: Iterable[str]) -> None:
    """Refuse to draw parameters of the dimer or the plate: motions are compared on one (ParameterError)."""
    for name in names:
        check_name(name)
        if name not in STARTING:
            raise ParameterError(f"{name}: is no part of a start; draw from {', '.join(STARTING)}")


def _spread(name: str, given: Any) -> tuple[float, float, float]:
    """Return both ends of a range and 0; of a normal distribution its mean, twice, and its standard deviation.

    All are in SI units.
    """
    if name == "phi0" and isinstance(given, str) and given == "any":
        return 0.0, tau, 0.0
    if isinstance(given, Mapping) and {*given} in ({"value", "within"}, {"value", "sigma"}):
        key = "sigma" if "sigma" in given else "within"
        value, by = (fixed_value(name, given[each]) for each in ("value", key))
        if by < 0:
            raise ParameterError(f"{name}: {key} = {by:g}: must be >= 0")
        return (value, value, by) if key == "sigma" else (value - by, value + by, 0.0)
    if not isinstance(given, list | tuple | np.ndarray) or len(given) != 2:
        about = '{"value": ..., "within": ...} or {"value": ..., "sigma": ...}'
        raise ParameterError(f"{name} = {given!r}: must be a pair of its least and its greatest value, or {about}")
    low, high = axis_values(name, given).tolist()
    return low, high, 0.0


def _without_phase(fixed: Any, drawn: Any) -> Any:
    """Return the fixed parameters with harmonics of the plate spelt out.

    Where phases are drawn, a phase 0 of the first harmonic is left out.
    """
    drawn = drawn.keys() if hasattr(drawn, "keys") else ()
    if "phi0" not in drawn or not isinstance(fixed, Mapping) or fixed.get("harmonics") is None:
        return fixed
    later = {name: fixed[name] for name in fixed if name in INSTEAD}  # parameters that they depend on may vary
    parameters = spelt_out({name: fixed[name] for name in fixed if name not in INSTEAD})
    return {name: value for name, value in parameters.items() if name != "phi0" or value} | later


def _on_one_plate(drawn: Grid, over: str) -> Grid:
    """Return the starts on one plate: its harmonics are turned along with the phase of each start.

    Raises
    ------
    ParameterError
        If the heading counts on the plate, or attractors are to be followed over the phase of a harmonic.
    """
    plate = drawn.fixed | drawn.columns
    check_level({name: float(np.abs(value).max()) for name, value in plate.items()}, "attractors")
    if "phi0" not in drawn.columns:
        return drawn
    if any(over == phase for _, phase in WAVES[0][1:]):
        raise ParameterError(f"{over}: cannot be followed from starts at several phases phi0; give one")
    idle = [intensity for intensity, _ in WAVES[0][1:] if not np.any(plate.get(intensity, 0.0))]
    moved = moved_on({name: value for name, value in plate.items() if name not in idle} | {"phi0": 0.0}, plate["phi0"])
    columns = {name: value for name, value in moved.items() if np.ndim(value)}
    return make_points(columns, {name: value for name, value in moved.items() if name not in columns})


def _axis_of(over: Mapping[str, Any] | None, columns: Mapping[str, np.ndarray]) -> tuple[str, np.ndarray]:
    """Return name and values of the parameter over which attractors are followed; "" and one value if there is none."""
    if over is None:
        return "", np.zeros(1)
    if not isinstance(over, Mapping) or len(over) != 1:
        raise ParameterError(f"over = {over!r}: must be a mapping of one parameter to its values")
    ((name, declared),) = over.items()
    values = axis_values(name, declared)
    if name in columns:
        raise ParameterError(f"{name}: is drawn and given in over; give it once")
    return name, values


@dataclass(frozen=True, kw_only=True)
class Census(Study):
    """A study of drawn starts, the same at each value of a parameter, and of the attractors that they come to.

    Parameters
    ----------
    starts : dict of str to ndarray
        Columns of the starts.
    over : str
        Parameter over which attractors are followed; "" for none.
    values : ndarray
        Values of the parameter.
    mirror : bool
        True if mirror images count as one motion.
    level : float
        Confidence of the intervals.
    confirm : int
        Forcing periods of a longer run of each attractor; 0 for none.
    slow : bool
        True if starts are told apart by their spin after infinite time.
    """

    observers: tuple[Observer, ...] = (EndStates(),)
    starts: dict[str, np.ndarray]
    over: str
    values: np.ndarray
    mirror: bool
    level: float
    confirm: int
    slow: bool

    def as_cube(self, results: np.ndarray) -> xr.Dataset:
        """Return the attractors from value to value, numbered as they appear; matched ones keep their numbers."""
        known: dict[int, Attractor] = {}  # each attractor as it was met last, by its number from 0
        rows: list[dict[int, Attractor]] = []  # attractors at each value of the parameter, by the same numbers
        checks: list[dict[int, bool]] = []
        for k, value in enumerate(self.values.tolist()):
            classifier = self._classifier(k, results)
            found, row = classifier.attractors(), {}
            found = classifier.by_fate(found) if self.slow else found
            costs = [
                [distance(old, new, self.over, value, classifier.mirrors) for new in found] for old in known.values()
            ]
            pairs = {new: old for old, new in matched(np.array(costs)).items()} if known else {}
            for j, attractor in enumerate(found):
                number = pairs.get(j, len(known))
                known[number] = row[number] = attractor
            rows.append(row)
            if self.confirm:
                checks.append({number: classifier.confirmed(each, self.confirm) for number, each in row.items()})
        axis = self.over or "value"
        data = self._labelled(rows, len(known), axis)
        if checks:
            stays = [[row.get(k, False) for k in range(len(known))] for row in checks]
            data["confirmed"] = column((axis, "attractor"), stays, "whether a longer run is still there")
        for each in (field for observer in self.observers[1:] for field in observer.fields):
            data[each.name] = self._of_each_start(each, results[each.name], axis)
            if each.along:
                data = data.assign_coords({each.along.name: coordinate(*each.along)})
        if not self.over:
            data = data.isel({axis: 0})
        else:
            data = data.assign_coords({axis: (axis, self.values, PARAMETERS[axis].attributes())})
            self._add_changes(data, rows)
        cost = float(results["codes"][:, CODE_N_PERIODS].sum())
        data = data.assign_coords(fixed_coordinates(self.grid.fixed)).assign_attrs(plot="attractors", cost=cost)
        return finished(data, TITLE)

    def _labelled(self, rows: Sequence[Mapping[int, Attractor]], number: int, axis: str) -> xr.Dataset:
        """Return the attractors at each value, `number` in all, and the attractor of each start, as a dataset."""
        from scipy.stats import binomtest

        over, n, none = (axis, "attractor"), self.size // self.values.size, np.zeros(0)
        places = [(k, place) for k, row in enumerate(rows) for place in row]
        found = [one for row in rows for one in row.values()]
        multipliers = multiplier_columns(none if one.orbit is None else one.orbit.multipliers for one in found)
        data = xr.Dataset(coords={"attractor": column("attractor", 1 + np.arange(number), "its number")})
        columns = (*_READ, *(_FATE if self.slow else ()), *multipliers)
        data = data.assign(over_grid(table(found, columns, "found"), places, over, (len(rows), number)))
        absent = data["count"].values == 0
        for name, value in {"representative": NONE, "multipliers_real": 0.0, "multipliers_imag": 0.0}.items():
            data[name].values[absent] = value
        data["share"] = column(over, data["count"] / n, "share of the starts")
        counts = data["count"].values.tolist()
        # doi 10.1080/01621459.1927.10502953
        intervals = [[binomtest(count, n).proportion_ci(self.level, "wilson") for count in row] for row in counts]
        for end, bound in zip(("low", "high"), np.moveaxis(np.array(intervals), -1, 0), strict=True):
            data[f"share_{end}"] = column(over, bound, f"{end} end of the share's interval")
            data[f"share_{end}"].attrs["level"] = self.level
        basin = np.zeros((len(rows), n), dtype=np.int64)
        for k, row in enumerate(rows):
            for place, attractor in row.items():
                basin[k, attractor.members] = place + 1
        data["basin"] = column((axis, "start"), basin, "number of the attractor that a start leads to")
        return data.assign_coords({key: column("start", each, PARAMETERS[key]) for key, each in self.starts.items()})

    def _of_each_start(self, field: Field, values: np.ndarray, axis: str) -> xr.Variable:
        """Return the values of an observed field for each start, with their dimensions."""
        dims = (axis, "start", *([field.along.name] if field.along else []))
        return column(dims, values.reshape(self.values.size, -1, *field.shape), field.quantity)

    def _classifier(self, k: int, results: np.ndarray) -> Classifier:
        """Return the classifier of the motions at the `k`-th value."""
        n = self.size // self.values.size
        here, _ = self.grid.window(k * n, (k + 1) * n)
        first = here.fixed | {key: float(column[0]) for key, column in here.columns.items()}
        return Classifier(here, self.how, results[k * n : (k + 1) * n], mirrors_of(first, self.mirror))

    def _add_changes(self, data: xr.Dataset, rows: Sequence[Mapping[int, Attractor]]) -> None:
        """Add the attractors that appear or go between two values, and the border of their orbit on the way."""
        changes = []
        for k in range(len(rows) - 1):
            for number in sorted(rows[k].keys() ^ rows[k + 1].keys()):
                goes = number in rows[k]
                attractor = rows[k if goes else k + 1][number]
                beyond = float(self.values[k + 1 if goes else k])
                border = (float("nan"), "none")
                if attractor.orbit is not None:
                    border = border_between(attractor.orbit, self.over, beyond)
                changes.append((number + 1, "goes" if goes else "appears", *self.values[k : k + 2], *border))
        words = {"what": ("appears", "goes"), "border_kind": (*kind_words(), "lost")}
        for k, (name, kind, units, meaning) in enumerate(_CHANGE):
            entries: np.ndarray = np.array([row[k] for row in changes], dtype=kind)
            unit = PARAMETERS[self.over].units if units is None else units
            data[name] = column("change", entries, Quantity(unit, meaning), words.get(name, ()))


def _of_orbit(name: str, attractor: Attractor) -> float:
    """Return a number of the orbit of an attractor; NaN without an orbit."""
    return nan if attractor.orbit is None else float(getattr(attractor.orbit, name))


def _sequence(attractor: Attractor) -> str:
    """Return the symbol sequence of an attractor, "" if it has none."""
    if attractor.orbit is not None:
        return attractor.orbit.sequence
    return "" if attractor.features is None else attractor.features.sequence


def _periods(attractor: Attractor) -> int:
    """Return the forcing periods after which an attractor repeats; 0 if it does not."""
    return 0 if attractor.features is None else attractor.features.periods


# variables of each attractor
_READ = (
    Column("count", "number of starts that lead there", lambda one: one.members.size),
    Column("mode", "mode of the representative", attrgetter("mode"), MODES),
    Column("periods", "forcing periods after which it repeats; 0 if it does not", _periods),
    Column("word", "sequence of contact states", _sequence),
    Column("representative", "number of a start that leads there", attrgetter("representative")),
    Column("orbit", "whether its orbit was found", lambda one: one.orbit is not None),
    Column("stable", "whether an orbit was found that is stable", lambda one: bool(one.orbit and one.orbit.stable)),
    *(Column(name, COLUMNS[name], partial(_of_orbit, name)) for name in OF_AN_ORBIT),
)
# further variables of each attractor with `slow`
_FATE = (
    Column("fate", "how the spin stays where it comes to", lambda one: one.fate.kind if one.fate else "none", FATES),
    Column("spin_low", MEANINGS["spin_low"], lambda one: one.fate.low if one.fate else nan),
    Column("spin_high", MEANINGS["spin_high"], lambda one: one.fate.high if one.fate else nan),
)
# variables of a change: name, type, unit (that of the parameter, if None), meaning
_CHANGE = (
    ("changed", np.int64, "1", "number of the attractor that appears or goes"),
    ("what", str, "1", "whether it appears or goes"),
    ("last", float, None, "value before the change"),
    ("next", float, None, "value behind the change"),
    ("border", float, None, "where its orbit ends or loses its stability"),
    ("border_kind", str, "1", "kind of that border"),
)
# names that the result has besides the columns of its starts, which an observer must not take
_NAMES = (
    *("attractor", "start", "multiplier", "change", "value", "share", "share_low", "share_high", "basin", "confirmed"),
    *("multipliers_real", "multipliers_imag", *(str(each[0]) for each in (*_READ, *_FATE, *_CHANGE))),
)
