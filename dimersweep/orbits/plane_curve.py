"""Borders as curves in the plane of two parameters, which may turn round in either.

The unknowns are those of a point of the border (the orbit, for a bifurcation its eigenvector, the first parameter) and the
second parameter: one more than there are equations. They are followed by `continuation`.
"""

from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from dimersweep.errors import OrbitError, ParameterError
from dimersweep.inputs import check_count, check_rtol, number
from dimersweep.orbits.branch import Axis
from dimersweep.orbits.continuation import FOLLOWING, LOCATED, SAME_WAY, Between, halved, steps, zero
from dimersweep.orbits.curve import Curve, Found
from dimersweep.orbits.finding import RTOL, checked, checked_spin
from dimersweep.orbits.kinds import BORDER_KINDS, Kind, change_of
from dimersweep.orbits.newton import TOLERANCE, newton
from dimersweep.orbits.orbit import Column, PeriodicOrbit, dataset
from dimersweep.orbits.poincare import OrbitLost, singular_lost
from dimersweep.orbits.specials import MOST_CHANGES
from dimersweep.parameters import check_effect, check_name
from dimersweep.symbols import PARAMETERS

SHORT_ARC = 1e-3  # step from which on a kink is not avoided any more
CHANGE_LOCATED = 1e-7  # how well a change of sequence is known, as a share of a step


class Place(NamedTuple):
    """A point of a border in the plane of two parameters; see `continuation.OnCurve`."""

    curve: Curve  # of the first parameter
    other: Axis  # the second one
    found: Found  # with the orbit
    near: Found  # with whose equations, and in whose section, it was found
    # all unknowns; the second parameter over its scale is the last one, the first one that before, shape (n + 1,)
    y: np.ndarray
    tangent: np.ndarray  # of length one, shape (n + 1,)

    def judge(self, to: "Place", step: float) -> None:
        """Refuse a step over which the curve turns too far, or to a point whose derivatives are of two maps."""
        if np.linalg.norm(to.y - self.y) > step / SAME_WAY or self.tangent @ to.tangent < SAME_WAY:
            raise OrbitLost("the curve turns too sharply")
        if step >= SHORT_ARC and _at_kink(to.found):
            raise OrbitLost("the map has a kink there")

    def elsewhere(self) -> "tuple[Place, ...]":
        """None: a point of a border is in the section that suits it."""
        return ()

    def settled(self, simplest: bool = True) -> "Place":
        """The point with the unknowns of its own section."""
        found = self.found
        y = np.append(found.begin.y, found.orbit.parameters[self.other.name] / self.other.scale)
        same = found.begin.map.phase == self.near.begin.map.phase and y.size == self.y.size
        along = self.tangent if same else self.tangent[-2:]
        return self._replace(near=found, y=y)._tangential(along)

    def on_plane(self, y: np.ndarray, normal: np.ndarray) -> "Place":
        """The point of the curve on the plane through `y` across `normal`."""

        def value(there: np.ndarray) -> tuple[np.ndarray, Any]:
            fails, extra = self._value(there)
            return np.append(fails, normal @ (there - y)), extra

        def derivative(there: np.ndarray) -> np.ndarray:
            return np.vstack([self._derivative(there), normal])

        root = newton(value, y, derivative, TOLERANCE * self.curve.rtol)
        found = self.curve.made(root.y[:-1], root.extra, self.near)
        return self._replace(found=found, y=root.y)._tangential(self.tangent)

    def _system(self, y: np.ndarray) -> Any:
        """The equations of the border at the second parameter."""
        return self.curve.system(self.other.map_at(self.near.begin.map, y[-1]), self.near)

    def _value(self, y: np.ndarray) -> tuple[np.ndarray, Any]:
        return self._system(y).value(y[:-1])

    def _derivative(self, y: np.ndarray) -> np.ndarray:
        """Of all equations, shape (n, n + 1)."""
        step = self.near.begin.map.step
        ahead, back = (self._value(y + by * step * np.eye(y.size)[-1])[0] for by in (1, -1))
        return np.column_stack([self._system(y).derivative(y[:-1]), (ahead - back) / (2 * step)])

    @singular_lost()
    def _tangential(self, along: np.ndarray) -> "Place":
        """The point with its tangent, in the sense of `along`, of all unknowns or the last ones."""
        tangent = np.linalg.svd(self._derivative(self.y))[2][-1]
        return self._replace(tangent=tangent if tangent[-along.size :] @ along >= 0 else -tangent)

    def tests(self) -> dict[str, float]:
        """Functions that change their sign where the curve meets another border, or turns round, by the names of that."""
        turns = {f"turn {self.curve.parameter}": self.tangent[-2], f"turn {self.other.name}": self.tangent[-1]}
        return self.curve.tests(self.found) | turns

    def special(self, b: "Place") -> "list[tuple[Place, str]]":
        """Where the curve meets other borders, or turns round, up to another of its points, in their order."""
        at, kind = Between(self, b), self.curve.kind

        def met(name: str) -> float | None:
            return zero(at, lambda place: place.tests()[name], LOCATED)

        found = [(share, name) for name in self.tests() if (share := met(name)) is not None]
        low, sequence, last = 0.0, self.found.orbit.sequence, b.found.orbit.sequence
        while kind.rows and sequence != last and len(found) < MOST_CHANGES:
            low, high = halved(lambda share: at[share].found.orbit.sequence, low, 1.0, CHANGE_LOCATED)
            if high - low > CHANGE_LOCATED:
                break
            after = at[high].found.orbit.sequence
            found.append((low, f"{kind.name}-{change_of(sequence, after).name}"))
            low, sequence = high, after
        return [(at[share], name) for share, name in sorted(found)]

    def to_end(self, span: tuple[float, float], points: int) -> "tuple[list[tuple[Place, str]], str]":
        """The points of a curve from this one on, each with what is special there, and why it ends."""
        rows: list[tuple[Place, str]] = []
        edges = {value / self.other.scale: value for value in span}
        try:
            for a, b, edge in islice(steps(self, FOLLOWING, tuple(edges)), points):
                rows += [*a.special(b), (b, "")]
                if edge is not None:
                    return rows, f"{self.other.name} = {edges[edge]:g} is reached"
        except OrbitLost as reason:
            return rows, f"lost: {reason}"
        return rows, f"{points} points were asked for"


def _at_kink(found: Found) -> bool:
    """Whether contacts change so near a point that its derivatives are of two maps; the name of a hop counts for nothing."""
    fixed = found.orbit.fixed
    steps = 2 * fixed.map.step * np.eye(fixed.z.size)
    sequences = (fixed.map.image(fixed.z + d).passage.sequence for d in (0.0, *steps, *-steps))
    return len({sequence.split(" far")[0] for sequence in sequences}) > 1


def border_curve(
    kind: str,
    parameter: str,
    other: str,
    *,
    span: tuple[float | str, float | str],
    spin: float | None = None,
    start: PeriodicOrbit | None = None,
    points: int = 200,
    rtol: float = RTOL,
    **fixed: float,
) -> xr.Dataset:
    """A border as a curve in the plane of two parameters, which may turn round in either.

    Parameters
    ----------
    kind : str
        fold, flip, torus or hop.
    parameter, other : str
        The two parameters.
    span : tuple of float or str
        Values of `other` at which the curve ends. It is begun halfway, and followed to both sides.
    spin : float, optional
        Axial spin [rad s-1], as in `border`.
    start : PeriodicOrbit, optional
        From which the first point is looked for.
    points : int
        Points to either side at most, special ones aside.
    rtol : float
        Accuracy of the map [1].
    **fixed : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along `point`, from one end of the curve to the other: both parameters, the attributes of the border's
        `PeriodicOrbit`, `loses_stability` and `doubling` as in `border`, and `meets`: the two borders that meet in a row
        (hop-fold), or "turn" with the parameter in which the curve turns round there, each located to 1e-6 or better. At
        flip-doubled_fold the fold of the orbit of twice the period ends on the flip (generalised flip). The attribute `ends`
        says why the curve ends on either side, `cost` how many forcing periods of the map it took.

    Raises
    ------
    ParameterError
        For an unknown kind or parameter, or a value that is not allowed.
    OrbitError
        If no point of the border is found.

    Examples
    --------
    >>> from dimersweep import orbits
    >>> fold = orbits.border_curve("fold", "Gamma", "e", span=(0.59, 0.61), spin=100.0)
    >>> bool((fold["Gamma"].diff("point") * fold["e"].diff("point") < 0).all())
    True
    """
    low, high, given, border = _judged(kind, parameter, other, span, fixed)
    spin, points = checked_spin(spin, given), check_count("points", points)
    curve = border.curve(border, parameter, given, spin, check_rtol(rtol))
    try:
        found = curve.point({}, [], start)
        axis = Axis(other, max(abs(low), abs(high)), spin)
        begin = Place(curve, axis, found, found, np.empty(0), np.array([0.0, 1.0])).settled()
    except OrbitLost as reason:
        raise OrbitError(f"no curve of a {kind} is begun at {other} = {given[other]:.6g}: {reason}") from reason
    back, before = begin._replace(tangent=-begin.tangent).to_end((low, high), points)
    on, after = begin.to_end((low, high), points)
    return _table(curve, other, [*back[::-1], (begin, ""), *on], [before, after])


def _judged(
    kind: str, parameter: str, other: str, span: tuple[float | str, float | str], fixed: dict[str, float]
) -> tuple[float, float, dict[str, float], Kind]:
    """The span, all parameters halfway, and the kind; refuses what is not allowed."""
    allowed = [name for name, one in BORDER_KINDS.items() if one.has_equation]
    if kind not in allowed:
        raise ParameterError(f"kind = {kind!r}: has no curve (allowed: {', '.join(allowed)})")
    for name in (parameter, other):
        check_name(name)
    if parameter == other or {parameter, other} & fixed.keys():
        raise ParameterError(f"{other if other in fixed or parameter == other else parameter}: is given twice")
    try:
        low, high = (number("span", value, PARAMETERS[other].units) for value in span)
    except (TypeError, ValueError):
        raise ParameterError(f"span = {span!r}: must be the least and the greatest value of {other}") from None
    if not low < high:
        raise ParameterError(f"span = ({low:g}, {high:g}): the first must be below the second")
    check_effect({parameter, other, *fixed})
    for value in (low, high):
        checked(fixed | {other: value})
    return low, high, checked(fixed | {other: 0.5 * (low + high)}), BORDER_KINDS[kind]


def _table(curve: Curve, other: str, rows: list[tuple[Place, str]], ends: list[str]) -> xr.Dataset:
    found = [place.found for place, _ in rows]
    meets = "the two borders that meet there, or the parameter in which the curve turns"
    both: dict[str, Column] = {
        curve.parameter: ([one.value for one in found], PARAMETERS[curve.parameter]),
        other: ([one.orbit.parameters[other] for one in found], PARAMETERS[other]),
    }
    columns = both | Curve.columns(curve, found) | {"meets": ([special for _, special in rows], meets)}
    table = dataset([one.orbit for one in found], "point", columns)
    table.attrs |= {"kind": curve.kind.name, "parameter": curve.parameter, "other": other, "ends": ends}
    table.attrs |= {"spin": curve.spin, "cost": curve.recorder.periods}
    return table.set_coords(list(both))
