"""Kinds of borders. A kind in `BORDER_KINDS` is known to curves, branches, files, pictures and pages."""

from dimersweep.orbits.kinds.changes import CHATTER, DOUBLE_IMPACT, HOP, LIFT_OFFS, STICK_SLIP, WORD
from dimersweep.orbits.kinds.flip import FLIP
from dimersweep.orbits.kinds.fold import FOLD
from dimersweep.orbits.kinds.kind import Kind
from dimersweep.orbits.kinds.stability import STABLE_FROM, STABLE_TO
from dimersweep.orbits.kinds.torus import TORUS

BORDER_KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (FOLD, FLIP, TORUS, STABLE_FROM, STABLE_TO, WORD, STICK_SLIP, LIFT_OFFS, DOUBLE_IMPACT, CHATTER, HOP)
}
