"""Start a run from any state: check what a user gives as a start, and convert it to the kernel's state."""

from collections.abc import Mapping
from math import degrees, pi
from typing import Any, TypeGuard

import numpy as np
import xarray as xr

from dimersweep.errors import ParameterError, unknown
from dimersweep.inputs import as_number
from dimersweep.kernel.model.body import dimer_of, rise_at
from dimersweep.kernel.model.layout import D1, D2, FREE, N1, N2, N_STATE, Dimer, State
from dimersweep.kernel.model.plate import motion
from dimersweep.kernel.numerics.elementary import sine_and_cosine
from dimersweep.parameters import dimer_from
from dimersweep.symbols import FORMER_NAMES, STATE_QUANTITIES

CLOSED_GAP = 1e-12  # size below which a gap counts as closed [m]: round-off of heights; more below zero is refused
# greatest disagreement of the gaps of a start with its dip angle, in units of the distance of the balls
GAPS_AGREE = 1e-9


def start_of(start: Any) -> dict[str, float]:
    """Return a start as numbers in SI units, by the names of `STATE_QUANTITIES`.

    Parameters
    ----------
    start : mapping of str to float or str, or xarray.Dataset
        Values of `Run.states` (an angle may be a text such as "16 deg"), or one time of it.

    Raises
    ------
    ParameterError
        If a name is unknown, a value is no finite number, or the dataset has several times.
    """
    for name in FORMER_NAMES:
        if isinstance(start, xr.Dataset | Mapping) and name in start:
            raise ParameterError(
                f"start.{name}: is {FORMER_NAMES[name]} now; spin is gamma_rate + theta_rate sin(beta)"
            )
    if isinstance(start, xr.Dataset):
        return {
            str(name): _one(str(name), value)
            for name, value in start.variables.items()
            if str(name) in STATE_QUANTITIES
        }
    if not isinstance(start, Mapping):
        raise ParameterError(f"start = {start!r}: must be a mapping, one time of Run.states, or a run")
    for name in start:
        if name not in STATE_QUANTITIES:
            raise ParameterError("start." + unknown(name, "quantity of a state", STATE_QUANTITIES))
    return {name: as_number(f"start.{name}", value, STATE_QUANTITIES[name].units) for name, value in start.items()}


def _one(name: str, variable: Any) -> float:
    """Return the single value of a variable of a start, in its SI unit; raise `ParameterError` if there are several."""
    if variable.size != 1:
        raise ParameterError(f"start.{name}: has {variable.size} values; give one time, such as states.isel(time=-1)")
    return as_number(f"start.{name}", variable.squeeze(), STATE_QUANTITIES[name].units)


def is_point(start: Any) -> TypeGuard[xr.Dataset]:
    """Return True if `start` is one point of a cube, which gives parameters in place of a state."""
    return isinstance(start, xr.Dataset) and "mode" in start and "gap_1" not in start


def kernel_start(start: Mapping[str, float], parameters: Mapping[str, float]) -> np.ndarray:
    """Return the kernel's state of a start, shape (1, N_START), float64, at the start of a forcing period.

    Values that are not given are zero. If no gap is given, the dimer touches the plate. Gaps and their rates count
    first, and heights only where these are missing.

    Parameters
    ----------
    start : mapping
        Values by the names of `STATE_QUANTITIES`, see `start_of`. The `phase` is ignored: it is in `parameters`.
    parameters : mapping
        Parameters of the run, with its plate and its dimer.

    Raises
    ------
    ParameterError
        If the dip angle is not below a right angle, a gap is negative, or the gaps contradict the dip angle.
    """
    beta = start.get("beta", 0.0)
    if not abs(beta) < pi / 2:
        shown = f"{beta} ({degrees(beta):.6g} deg)"
        raise ParameterError(
            f'start.beta = {shown}: must be below pi/2 = 1.5708 in size (radians; degrees as "16 deg")'
        )
    dm = dimer_from(parameters)
    gaps, beta_rate = _gaps(start, dm, rise_at(dm, beta)), start.get("beta_rate", 0.0)
    theta, theta_rate = start.get("theta", 0.0), start.get("theta_rate", 0.0)
    u, v = start.get("x1_rate", 0.0), start.get("y1_rate", 0.0)
    rise_rate = start["z1_rate"] - float(motion(dm, dm.phi0)[1]) if "z1_rate" in start else 0.0
    (sin_b, cos_b), (sin_t, cos_t) = map(sine_and_cosine, (beta, theta))
    # turn rate of the axis across the heading; distance of ball 1 from the centre of mass along the heading
    across, away = theta_rate * cos_b, dm.p1.h * cos_b
    state = State(
        0.0,
        *gaps,
        *_both(start, "gap_{}_rate", dm.l * cos_b * beta_rate, rise_rate),
        dip=beta - dm.beta_0 if gaps[0] != gaps[1] else 0.0,
        wb=beta_rate,
        wp=across,
        spin=start.get("gamma_rate", 0.0) + theta_rate * sin_b,
        ca=v * cos_t - u * sin_t + dm.p1.h * sin_b * beta_rate,
        cb=u * cos_t + v * sin_t + dm.p1.h * across,
        theta=theta,
        x1=start.get("x1", start["x"] - away * sin_t if "x" in start else 0.0),
        y1=start.get("y1", start["y"] + away * cos_t if "y" in start else 0.0),
        gamma=start.get("gamma", 0.0),
    )
    return np.array([[*state, FREE, FREE]], float)


def _gaps(start: Mapping[str, float], dm: Dimer, rise: float) -> tuple[float, float]:
    """Return the gaps of p1 and p2 [m] from a start; the gap of p2 is larger by `rise`.

    Gaps smaller than `CLOSED_GAP` become 0.
    """
    lowest = max(0.0, -rise)
    if "z1" in start or "z" in start:
        centre = start["z1"] if "z1" in start else start["z"] + dm.p1.h * (dm.sin_0 + rise / dm.l)
        lowest = centre - dm.p1.r - float(motion(dm, dm.phi0)[0])
    first, second = _both(start, "gap_{}", rise, lowest)
    if abs(second - first - rise) > GAPS_AGREE * dm.l:
        raise ParameterError(f"start.gap_2 = {second}: must be gap_1 + l sin(beta) = {first + rise}; leave one out")
    for name, gap in (("gap_1", first), ("gap_2", second)):
        if gap < -CLOSED_GAP:
            raise ParameterError(f"start.{name} = {gap}: must be >= 0 (that end would be below the plate)")
    return (0.0 if first < CLOSED_GAP else first), (0.0 if second < CLOSED_GAP else second)


def _both(start: Mapping[str, float], name: str, apart: float, otherwise: float) -> tuple[float, float]:
    """Return the values for p1 and p2 that a start has by `name`, with the end in place of {}.

    If it has one of them, the value of p2 is larger by `apart`. If it has neither, p1 has the value `otherwise`.
    """
    one, two = name.format(1), name.format(2)
    first = start.get(one, start[two] - apart if two in start else otherwise)
    return first, start.get(two, first + apart)


def fitted(start: np.ndarray, before: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return the state of a dimer changed to fit a dimer of another length or other balls.

    The lower end keeps its gap and gap rate, and the higher end follows it. Dip above level, spin components and the
    velocity of the centre of mass along the plate stay, too. Nothing changes where the parameters do not change the
    shape.

    Parameters
    ----------
    start : ndarray, shape (1, N_START)
    before, row : ndarray, shape (N_ROW,)
        Parameters of the dimer that the state is of, and of the dimer that it is fitted to.

    Returns
    -------
    ndarray, shape (1, N_START)
    """
    old, new = dimer_of(before), dimer_of(row)
    if (old.l, old.sin_0) == (new.l, new.sin_0):
        return start
    s = State(*start[0, :N_STATE].tolist())
    half, between, now = map(sine_and_cosine, (0.5 * s.dip, new.beta_0 + 0.5 * s.dip, new.beta_0 + s.dip))
    # a difference of two sines as a product, which keeps all digits near level
    rise = 2.0 * new.l * half[0] * between[1]
    apart = new.l * now[1] * s.wb
    moved = start.copy()
    if s.d1 <= s.d2:
        moved[0, [D2, N2]] = s.d1 + rise, s.n1 + apart
    else:
        moved[0, [D1, N1]] = s.d2 - rise, s.n2 - apart
    return moved
