"""Step a scipy integrator to the first event, with certainty about events at the start and inside one step."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import OdeSolver
from scipy.optimize import brentq

Array = NDArray[np.float64]


class TooManySteps(RuntimeError):
    """The integrator needs more steps than allowed."""


def march(
    solver: OdeSolver,
    events: Callable[[float, Array], Array],
    slopes: Callable[[float, Array], Array] | None = None,
    on_step: Callable[[float, Callable[[float], Array]], None] | None = None,
    parts: int = 4,
    max_steps: int = 100000,
) -> tuple[float, Array, list[int]]:
    """Integrate until one of the event functions falls through zero, or to the solver's end.

    Parameters
    ----------
    solver : OdeSolver
        At its start.
    events : callable
        (s, y) -> values, shape (k,). An event happens where a value that *has been* positive reaches zero; a value that
        starts at or below zero must rise first.
    slopes : callable, optional
        (s, y) -> time derivatives of the first values. Where one is given, a dip below zero and back between two probes
        is found as well, through the zero of the derivative.
    on_step : callable, optional
        Called as on_step(s, dense) with the end of the valid stretch of each step and its interpolant.
    parts : int
        Probes per step.
    max_steps : int
        Raises `TooManySteps` beyond.

    Returns
    -------
    s, y, fired
        Where it stopped, and which events happened there (several where symmetry makes them coincide; none at the
        solver's end).
    """
    s_a = solver.t
    g_a = events(s_a, solver.y)
    armed = g_a > 0
    d_a = slopes(s_a, solver.y) if slopes else np.empty(0)
    steps = 0
    while solver.status == "running":
        steps += 1
        if steps > max_steps:
            raise TooManySteps
        message = solver.step()
        if solver.status == "failed":
            raise RuntimeError(f"integrator failed: {message}")
        dense = solver.dense_output()
        for s_b in np.linspace(solver.t_old, solver.t, parts + 1)[1:]:
            y_b = dense(s_b)
            g_b = events(s_b, y_b)
            d_b = slopes(s_b, y_b) if slopes else np.empty(0)
            roots = []
            for j in np.flatnonzero(armed):
                end = s_b if g_b[j] <= 0 else None
                if end is None and slopes and j < len(d_b) and d_a[j] < 0 < d_b[j]:
                    bottom = _root(slopes, dense, int(j), s_a, s_b)
                    end = bottom if events(bottom, dense(bottom))[j] <= 0 else None
                if end is not None:
                    roots.append((_root(events, dense, int(j), s_a, end), int(j)))
            if roots:
                s = min(roots)[0]
                if on_step:
                    on_step(s, dense)
                return s, dense(s), [j for root, j in roots if root <= s * (1 + 1e-12)]
            armed |= g_b > 0
            s_a, d_a = s_b, d_b
        if on_step:
            on_step(solver.t, dense)
    return solver.t, solver.y, []


def _root(
    functions: Callable[[float, Array], Array], dense: Callable[[float], Array], j: int, a: float, b: float
) -> float:
    """Zero in [a, b] of component `j` along the interpolant; `a` itself where round-off has already moved the sign."""

    def function(s: float) -> float:
        return float(functions(s, dense(s))[j])

    if function(a) * function(b) > 0:
        return a
    return float(brentq(function, a, b, xtol=1e-22, rtol=1e-14, maxiter=2000))
