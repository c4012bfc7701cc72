"""When a motion has settled, and with which period: when its fast part has.

A dimer turns and rolls on while its spin creeps, by some 1e-6 to 1e-3 of itself in a period, and nothing sustains it. All else
follows at once: a motion goes through a family of orbits, one for each spin, and its strobe moves along it. So a strobe x
(gaps and gap rates, in g/omega^2 and g/omega) and the spin s (r s in g/omega) have repeated over p periods in either case:

* *it is the same*: no entry of x has changed by more than SETTLED;
* *it creeps*: x has changed by less than s, so that the motion moves along the family and not across it, and its second
  difference, x less what x was about to be at the pace of the p periods before, is below LEFT. There the creep cancels
  but for its own slow change, and what is left is the fast part: with a multiplier m its second difference falls with m.

The motion has settled when it has repeated for PATIENCE periods. A fast part of which LEFT is left in each of them would have
changed x by SETTLED in all.
"""

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.verdict.past import N_NORMAL, P_SPIN, RING, RUNS, S_STROBES, SCALARS, STROBES, note_strobe

SETTLED = 1e-4  # change of a strobe, in g/omega^2 and g/omega, that counts as none
# share of a shorter period's change that is left after PATIENCE periods, below which it is on its way to none
FADING = 0.99
PATIENCE = 24  # periods a motion repeats before it counts as settled
LEFT = SETTLED / PATIENCE  # second difference of a strobe that counts as none
MAX_PERIOD = 16


@compiled
def note_period(dm, state, modes, past):
    """Strobe at a period boundary, and count for how long the motion has repeated with each period."""
    note_strobe(dm, state, modes, past)
    for p in range(1, MAX_PERIOD + 1):
        past[RUNS, p] = past[RUNS, p] + 1.0 if repeats(past, p) else 0.0


@compiled
def repeats(past, p):
    """Whether the motion has come back to where it was p periods ago, but for the creep of its spin."""
    count = int(past[SCALARS, S_STROBES])
    if count <= p:
        return False
    moved = change(past, p, 0)
    return moved <= SETTLED or (count > 2 * p and moved <= spin_change(past, p) and fast_change(past, p) <= LEFT)


@compiled
def spin_change(past, p):
    """How far the spin has come in the last p periods, in its unit."""
    last = int(past[SCALARS, S_STROBES]) - 1
    return abs(past[STROBES + last % RING, P_SPIN] - past[STROBES + (last - p) % RING, P_SPIN])


@compiled
def fast_change(past, p):
    """Second difference of the strobe over p periods: its change less that of the p periods before."""
    last = int(past[SCALARS, S_STROBES]) - 1
    row, old = past[STROBES + last % RING], past[STROBES + (last - p) % RING]
    older = past[STROBES + (last - 2 * p) % RING]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row[k] - 2.0 * old[k] + older[k]))
    return apart


@compiled
def last_strobe(past, strobe):
    """Copy the normal state of the last strobe into `strobe`; returns the largest change of an entry of it."""
    row = past[STROBES + (int(past[SCALARS, S_STROBES]) - 1) % RING]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row[k] - strobe[k]))
        strobe[k] = row[k]
    return apart


@compiled
def change(past, p, back):
    """Change of the strobe over p periods, `back` periods before the last one."""
    last = int(past[SCALARS, S_STROBES]) - 1 - back
    row, old = past[STROBES + last % RING], past[STROBES + (last - p) % RING]
    apart = 0.0
    for k in range(N_NORMAL):
        apart = max(apart, abs(row[k] - old[k]))
    return apart


@compiled
def largest_change(past, q, p, back):
    """Largest change over q periods in a stretch of p strobes, which ends `back` periods before the last one."""
    apart = 0.0
    for k in range(p):
        apart = max(apart, change(past, q, back + k))
    return apart


@compiled
def fades(past, p):
    """Whether a motion that repeats with period p rings down to a shorter one, a divisor of p."""
    shorter = False
    for q in range(1, p):
        shorter = shorter or (
            p % q == 0 and largest_change(past, q, p, 0) < FADING * largest_change(past, q, p, PATIENCE)
        )
    return shorter


@compiled
def settled_period(past):
    """Least number of forcing periods with which the motion has repeated long enough, 0 if with none."""
    for p in range(1, MAX_PERIOD + 1):
        if past[RUNS, p] >= PATIENCE + p and not fades(past, p):
            return p
    return 0


@compiled
def spin_drift(dm, past, p):
    """Change of the spin per forcing period over the last periods of a motion of period p [rad/s]."""
    last, span = int(past[SCALARS, S_STROBES]) - 1, p * (PATIENCE // p)
    change = past[STROBES + last % RING, P_SPIN] - past[STROBES + (last - span) % RING, P_SPIN]
    return change / span * dm.g / (dm.omega * dm.r)
