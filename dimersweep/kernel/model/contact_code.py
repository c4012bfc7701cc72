"""Code the contact state of Table 1 as one number, 5 s_1 + s_2, and name it.

The digit s_i of end i is FREE, STICK or SLIP; during an impact at that end IMPACT is added.
"""

from typing import Any

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.model.layout import FREE, IMPACT, SLIP, STICK

CODE_BASE = 5


def code_of(digit_1: Any, digit_2: Any) -> Any:
    """Return the code of a contact state with these digits of p1 and p2: numbers, or arrays of one shape."""
    return CODE_BASE * digit_1 + digit_2


coded = compiled(code_of, inline=True)  # for the kernel


def digits_of(code: Any) -> tuple[Any, Any]:
    """Return the digits of p1 and p2 in the code of a contact state: of a whole number, or of an array."""
    return divmod(code, CODE_BASE)


@compiled
def impact_digit(on, mode):
    """Return the digit of an end with this friction mode in a phase of an impact.

    `on` is True if the impact acts on the end: b_i of (8) is set.
    """
    return float(mode) + (IMPACT if on else FREE)


def contact_state_name(code: int) -> str:
    """Return the name of a contact state of Table 1, such as ``SC1_sp`` or ``DI_sp_sk``; ``SC1``: p1 alone is down."""
    s = digits_of(int(code))
    closed = [k for k in s if k > 0]
    if not closed:
        return "FM"
    family = ("D" if len(closed) == 2 else "S") + ("I" if max(closed) > SLIP else "C")
    if len(closed) == 1:
        family += "1" if s[0] > 0 else "2"
    return family + "".join("_sk" if k in (STICK, STICK + IMPACT) else "_sp" for k in closed)


CONTACT_STATES = tuple(contact_state_name(code) for code in range(CODE_BASE**2))
