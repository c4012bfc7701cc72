"""Simulate one run from its parameters."""

from collections.abc import Mapping
from math import remainder, tau
from typing import Any, Unpack

import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.inputs import check_seconds, check_switch
from dimersweep.parameters import ParameterKeywords, Parameters, check_names, moved_on, updated
from dimersweep.runs.point_source import parameters_of, was_carried
from dimersweep.runs.recorded import parameters_in
from dimersweep.runs.run import Run, proven_run, simulate_checked
from dimersweep.runs.solving import check_recorded, run_settings
from dimersweep.runs.starting import is_point, start_of
from dimersweep.symbols import START


def simulate(
    *,
    start: Any = None,
    periods: int = 100,
    rtol: float = 1e-8,
    stop_when_settled: bool = False,
    record: bool = True,
    max_seconds: float | str | None = None,
    **parameters: Unpack[ParameterKeywords],
) -> Run:
    """Run one dimer on its vibrating plate; the defaults are the paper's base case (Sect. 3).

    Parameters
    ----------
    start : mapping of str to float, xarray.Dataset, or Run, optional
        State to start from, in place of `beta0`, `xdot0` and the other parameters of a start. A mapping has values by
        the names of `Run.states`; values that are not given are zero, and the lower end is on the plate. A dataset is
        one time of `Run.states` or one point of `Run.section`; a run stands for its end. One point of a cube stands for
        the parameters of the run behind it.

        All but a mapping bring the parameters of their run, and parameters that are given replace them. Where these
        change the dimer's shape, its lower end stays in place. The plate is moved on to the `phase` of the state, which
        is the `phi0` of the new run.
    periods : int
        Forcing periods to run.
    rtol : float
        Accuracy of everything at once [1], 1e-13 to 1e-2.
    stop_when_settled : bool
        True to end the run as soon as its motion has settled and its numbers stand: in the periods that are left they
        would change by less than 1e-3 (docs/stopping.md).
    record : bool
        True to record events and states, of at most 100,000 forcing periods. Without them a run takes no memory and
        less time. A record of more than 2 million events is cut there; a warning and `Run.events` say so.
    max_seconds : float or str, optional
        Bound on the time that the run takes [s], or a text such as "5 min". A run that reaches it has the status
        "stopped", the `n_periods` completed by then, and the events and states up to there.
    **parameters : float or str
        Parameters of the model in SI units; an angle may be a text such as "16 deg", a length a text such as "2 mm".
        `Parameters` has their meanings, units and defaults. Of the dimer: `A_r` (or `l`), `r`, `D_r`, `rho_b`, `rho_r`,
        `e`, `mu`, `mu_s`, `mu_h`, `eta`, `k_ratio`, and of one end alone `r_1`, `r_2`, `rho_b_1`, `rho_b_2`, `e_1`,
        `e_2`, `mu_1`, `mu_2`, `mu_s_1`, `mu_s_2`, `mu_h_1`, `mu_h_2`. Of the plate: `Gamma` (or `A_z`, `v_z`), `f`,
        `phi0`, `g`, `tilt`, `azimuth`, `Gamma_2`, `phi_2`, `Gamma_x`, `phi_x`, `Gamma_y`, `phi_y`, and higher harmonics
        up to `phi_y_16`, or all as `harmonics`. Of the start: `beta0`, `xdot0`, `ydot0`, `theta0`, `betadot0`,
        `thetadot0`, `gammadot0`, `gap0`.

    Returns
    -------
    Run

    Raises
    ------
    ParameterError
        Naming the parameter, its value and what is allowed.
    KernelError
        If the compiled kernel cannot run here.

    Examples
    --------
    >>> from dimersweep import simulate
    >>> run = simulate(Gamma=0.9, f=15, beta0="16 deg", periods=60)
    >>> run.mode, run.orbit.di_end
    ('drift', 'sp_sk')
    """
    asked: dict[str, Any] = {**parameters}
    check_names(asked)
    if is_point(start):
        if was_carried(start):
            raise ParameterError(
                "start: to this point a state was carried, which the cube does not hold; take cube.dimersweep.run(...)"
            )
        asked, start = updated(parameters_of(start), asked), None
    if hasattr(start, "states"):  # a run
        start = start.states(start.duration)
    begun = None if start is None else start_of(start)
    known = parameters_in(start) if isinstance(start, xr.Dataset) else {}
    given = Parameters(**asked) if begun is None else _with_start(asked, known, begun)
    how = run_settings(periods=periods, rtol=rtol, stop_when_settled=stop_when_settled)
    seconds, before = check_seconds(max_seconds), Parameters(**known) if known else None
    if check_switch("record", record):
        check_recorded(how.periods)
    return proven_run(
        lambda space: simulate_checked(given, how, space, record=record, begun=begun, before=before), seconds
    )


def _with_start(given: Mapping[str, Any], known: Mapping[str, float], start: Mapping[str, float]) -> Parameters:
    """Return the parameters of a run from a state: the `known` ones of the state, with `given` ones in their place.

    If the state has a phase, the plate is moved on to it.
    """
    for name in START:
        if given.get(name) is not None:
            raise ParameterError(f"{name}: given together with start, which holds it; leave one out")
    parameters = Parameters(**updated(known, given))
    if "phase" not in start:
        return parameters
    if "phi0" in given:
        raise ParameterError("phi0: given together with start.phase; leave one out")
    moved = moved_on(parameters.given(), remainder(start["phase"] - parameters.phi0, tau))
    return Parameters(**moved | {"phi0": start["phase"]})
