"""The table of curves by class of kind of border, and the check of what a user asks for."""

from collections.abc import Mapping
from typing import Any

from dimersweep.analysis.orbits.borders.bifurcation_curve import BifurcationCurve, PitchforkCurve
from dimersweep.analysis.orbits.borders.curve import Curve
from dimersweep.analysis.orbits.borders.sequence_curve import SequenceCurve
from dimersweep.analysis.orbits.borders.stability_curve import StabilityCurve
from dimersweep.analysis.orbits.continuation.kinds import (
    BORDER_KINDS,
    Bifurcation,
    Change,
    Kind,
    Pitchfork,
    StabilityEnd,
)
from dimersweep.analysis.orbits.map.finding import checked, checked_spin
from dimersweep.errors import ParameterError
from dimersweep.inputs import as_numbers, check_rtol, check_switch
from dimersweep.parameters import check_effect, check_name, spelt_out
from dimersweep.symbols import PARAMETERS

CURVE_OF_KIND: dict[type[Kind], type[Curve]] = {
    Bifurcation: BifurcationCurve,
    Pitchfork: PitchforkCurve,
    Change: SequenceCurve,
    StabilityEnd: StabilityCurve,
}


def asked(
    kind: str,
    parameter: str,
    over: Mapping[str, Any],
    spin: float | None,
    rtol: float,
    fixed: dict[str, float],
    sustained: Any,
) -> Curve:
    """Return the curve of a kind of border, with its parameters at the first values of `over`.

    Raise ParameterError for an unknown kind, and for a parameter or a value that is not allowed.
    """
    if kind not in BORDER_KINDS:
        raise ParameterError(f"kind = {kind!r}: unknown border (allowed: {', '.join(BORDER_KINDS)})")
    check_name(parameter)
    if not isinstance(over, Mapping) or not over:
        raise ParameterError(f"over = {over!r}: must name at least one parameter with its values")
    fixed = spelt_out(fixed, dict.fromkeys((parameter, *over)))
    axes = {}
    for name, values in over.items():
        check_name(name)
        if name == parameter or name in fixed:
            raise ParameterError(f"{name}: is given twice")
        axes[name] = as_numbers(name, values, PARAMETERS[name].units)
        if not axes[name].size:
            raise ParameterError(f"over: {name} has no values")
    check_effect({parameter, *axes, *fixed})
    for name, column in axes.items():
        for value in column:
            checked(fixed | {name: float(value)})
    given = checked(fixed | {name: float(values[0]) for name, values in axes.items()})
    border = BORDER_KINDS[kind]
    curve = next(curve for kinds, curve in CURVE_OF_KIND.items() if isinstance(border, kinds))
    spin, rtol = checked_spin(spin, given), check_rtol(rtol)
    return curve(border, parameter, given, spin, rtol, over=axes, sustained=check_switch("sustained", sustained))
