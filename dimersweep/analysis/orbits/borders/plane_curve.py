"""Borders as curves in the plane of two parameters, which may turn round in either parameter.

The unknowns are those of a point of the border and the second parameter, one more than there are equations. A point of
the border has the orbit, the first parameter and, at a bifurcation, the eigenvector. Curves are
followed by `continuation.steps`.
"""

from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.borders.curve import Curve, Found, meetings
from dimersweep.analysis.orbits.borders.curves import asked
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS
from dimersweep.analysis.orbits.continuation.steps import FOLLOWING, SAME_WAY, Between, steps
from dimersweep.analysis.orbits.map.finding import RTOL
from dimersweep.analysis.orbits.map.lost import OrbitLost, require, singular_lost
from dimersweep.analysis.orbits.map.orbit import PeriodicOrbit
from dimersweep.analysis.orbits.map.solution import Axis, newton, target
from dimersweep.cubes.cube import Column, finished
from dimersweep.errors import OrbitError, ParameterError
from dimersweep.inputs import as_number, check_count, pair_of
from dimersweep.parameters import check_name
from dimersweep.symbols import PARAMETERS

# length of a step below which a kink is not avoided: a curve that runs along a kink could not go on
SHORT_ARC = 1e-3
CHANGE_LOCATED = 1e-7  # accuracy of meetings and turns, as a share of a step


@dataclass(frozen=True)
class InPlane:
    """A point of a border in the plane of two parameters, from which steps are taken: see `continuation.steps.OnCurve`.

    It is a type of its own, beside `Solution`, since the problem that it solves is that of any border: its last two
    unknowns, `y[-2]` and `y[-1]`, are the first and the second parameter over their scales.
    """

    curve: Curve
    found: Found
    y: np.ndarray
    other: Axis  # the second parameter
    near: Found  # the point with whose equations, and in whose section, this one was found
    tangent: np.ndarray  # tangent of the curve, of length one, shape (n + 1,)
    slope: np.ndarray | None = None  # derivative of all equations at `y`, shape (n, n + 1)

    def judge(self, to: "InPlane", step: float) -> None:
        """Require that the curve turns little over a step, and that it does not come to a kink of the map."""
        near = np.linalg.norm(to.y - self.y) <= step / SAME_WAY
        require(near and self.tangent @ to.tangent >= SAME_WAY, "the curve turns too sharply")
        require(step < SHORT_ARC or not _at_kink(to.found), "the map has a kink there")

    def elsewhere(self) -> "tuple[InPlane, ...]":
        """Return no points: a point of a border is in the section that suits it already."""
        return ()

    def settled(self, simplest: bool = True) -> "InPlane":
        """Return the point with the unknowns of its own section."""
        found = self.found
        y = np.append(found.begin.y, found.orbit.parameters[self.other.name] / self.other.scale)
        same = found.begin.map.phase == self.near.begin.map.phase and y.size == self.y.size
        # in another section only the parameters, the last two unknowns, are the same quantities
        along = self.tangent if same else self.tangent[-2:]
        return replace(self, near=found, y=y)._tangential(along)

    def on_plane(self, y: np.ndarray, normal: np.ndarray) -> "InPlane":
        """Return the point of the curve on the plane through `y` across `normal`."""

        def value(there: np.ndarray) -> tuple[np.ndarray, Any]:
            fails, extra = self._value(there)
            return np.append(fails, normal @ (there - y)), extra

        def derivative(there: np.ndarray) -> np.ndarray:
            return np.vstack([self._derivative(there), normal])

        known = None if self.slope is None else np.vstack([self.slope, normal])
        y, extra, _, _ = newton(value, y, derivative, target(self.near.begin.map, self.curve.sustained), known)
        found = self.curve.made(y[:-1], extra, self.near)
        return replace(self, found=found, y=y)._tangential(self.tangent)

    def _system(self, y: np.ndarray) -> Any:
        """Return the equations of the border at the second parameter of `y`."""
        return self.curve.system(self.other.map_at(self.near.begin.map, y[-1]), self.near)

    def _value(self, y: np.ndarray) -> tuple[np.ndarray, Any]:
        return self._system(y).value(y[:-1])

    def _derivative(self, y: np.ndarray) -> np.ndarray:
        """Return the derivative of all equations by `y`, shape (n, n + 1)."""
        step = self.near.begin.map.step
        ahead, back = (self._value(y + by * step * np.eye(y.size)[-1])[0] for by in (1, -1))
        return np.column_stack([self._system(y).derivative(y[:-1]), (ahead - back) / (2 * step)])

    @singular_lost()
    def _tangential(self, along: np.ndarray) -> "InPlane":
        """Return the point with its tangent in the sense of `along`, a vector of all unknowns or of the last two."""
        slope = self._derivative(self.y)
        tangent = np.linalg.svd(slope)[2][-1]
        return replace(self, tangent=tangent if tangent[-along.size :] @ along >= 0 else -tangent, slope=slope)

    def tests(self) -> dict[str, float]:
        turns = {f"turn {self.curve.parameter}": self.tangent[-2], f"turn {self.other.name}": self.tangent[-1]}
        return self.curve.tests(self.found) | turns

    def meetings(self, b: "InPlane") -> "list[tuple[InPlane, str]]":
        """Return the points up to `b` at which the curve meets other borders or turns round, with the names of these."""
        way = b.y - self.y

        def found(before: InPlane, _: InPlane, part: float, share: float) -> InPlane:
            # the equations of the last known point before it are nearly those of the new one
            return before.on_plane(self.y + share * way, way / np.linalg.norm(way))

        def state(at: InPlane) -> str:
            return self.curve.state(at.found)

        return meetings(self.curve, Between(self, b, found), InPlane.tests, state, CHANGE_LOCATED)

    def to_end(self, span: tuple[float, float], points: int) -> "tuple[list[tuple[InPlane, str]], str]":
        """Follow the curve from this point on: return the points, and why the curve ends.

        Each point stands beside the name of the meeting or turn there, "" if there is none.
        """
        rows: list[tuple[InPlane, str]] = []
        edges = {value / self.other.scale: value for value in span}
        try:
            for a, b, edge in islice(steps(self, FOLLOWING, tuple(edges)), points):
                rows += [*a.meetings(b), (b, "")]
                if edge is not None:
                    return rows, f"{self.other.name} = {edges[edge]:g} is reached"
        except OrbitLost as reason:
            return rows, f"lost: {reason}"
        return rows, f"{points} points were asked for"


def _at_kink(found: Found) -> bool:
    """Return True if the sequence changes within the differences at a point, so that these mix two maps.

    The symbols of long hops (far) do not count: the map is smooth where they change.
    """
    fixed = found.orbit.fixed
    steps = 2 * fixed.map.step * np.eye(fixed.z.size)
    sequences = (fixed.map.passage(fixed.z + d).sequence for d in (0.0, *steps, *-steps))
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
    sustained: bool = False,
    **fixed: float,
) -> xr.Dataset:
    """Follow a border as a curve in the plane of two parameters, which may turn round in either.

    Parameters
    ----------
    kind : str
        fold, flip, torus, pitchfork or hop.
    parameter, other : str
        The two parameters.
    span : tuple of float or str
        Values of `other` at which the curve ends. It is begun halfway, and followed to both sides.
    spin : float, optional
        Axial spin [rad s-1], as in `border`.
    start : PeriodicOrbit, optional
        Orbit from which the first point is looked for; by default as in `border`.
    points : int
        Greatest number of points to either side. Meetings and turns do not count.
    rtol : float
        Accuracy of the map [1].
    sustained : bool
        Whether the spin is free, as in `border`.
    **fixed : float
        Parameters of the model.

    Returns
    -------
    xarray.Dataset
        Along `point`, from one end of the curve to the other: both parameters, the attributes of the border's
        `PeriodicOrbit`, `loses_stability` and `doubling` as in `border`, and `meets`. This column names the two borders
        that meet at a point (hop-fold), or has "turn" with the parameter in which the curve turns round. Both are
        located to 1e-6 or better. At flip-doubled_fold the fold of the orbit of twice the period ends on the flip
        (generalised flip). The attribute `ends` says why the curve ends on either side, `cost` how many forcing periods
        of the map were run.

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
    allowed = [name for name, one in BORDER_KINDS.items() if one.has_equation]
    if kind not in allowed:
        raise ParameterError(f"kind = {kind!r}: has no curve (allowed: {', '.join(allowed)})")
    check_name(other)
    if parameter in fixed:
        raise ParameterError(f"{parameter}: is given twice")
    both = pair_of("span", span, f"the least and the greatest value of {other}")
    low, high = (as_number("span", value, PARAMETERS[other].units) for value in both)
    if not low < high:
        raise ParameterError(f"span = ({low:g}, {high:g}): the first must be below the second")
    middle = 0.5 * (low + high)
    curve = asked(kind, parameter, {other: [middle, low, high]}, spin, rtol, fixed, sustained)
    points = check_count("points", points)
    try:
        found = curve.point({}, [], start)
        axis = Axis(other, max(abs(low), abs(high)), curve.spin)
        begin = InPlane(curve, found, np.empty(0), axis, found, np.array([0.0, 1.0])).settled()
    except OrbitLost as reason:
        raise OrbitError(f"no curve of a {kind} is begun at {other} = {middle:.6g}: {reason}") from reason
    back, before = replace(begin, tangent=-begin.tangent).to_end((low, high), points)
    on, after = begin.to_end((low, high), points)
    rows = [*back[::-1], (begin, ""), *on]
    all_found = [place.found for place, _ in rows]
    meets = "the two borders that meet there, or the parameter in which the curve turns"
    columns = [
        Column(other, PARAMETERS[other], [one.orbit.parameters[other] for one in all_found]),
        Column("meets", meets, [special for _, special in rows]),
        *Curve.columns(curve, all_found),
    ]
    table = curve.table(all_found, "point", columns)
    table = table.assign_attrs(other=other, ends=f"{before}; {after}").set_coords([parameter, other])
    return finished(table, f"Border of periodic orbits: {kind} over {parameter} and {other}")
