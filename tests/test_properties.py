"""What the model's symmetries and balances demand of every run, for scenes that hypothesis draws."""

from math import pi

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from dimersweep.kernel.contact.coordinates import N_Y, Y
from dimersweep.kernel.contact.forces import COMPLIANCE, N_F
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.layout import FREE, N_STATE, ROW, SLIP, STICK, State
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES
from dimersweep.parameters import Parameters
from tests.checks import examine
from tests.checks.examine import integrals, kinetic, lab_gain, of_centre, phases_of, slips, states_at, total
from tests.checks.launch import begin, launch
from tests.checks.random_scenes import BLOCK, laboratory_row
from tests.checks.scenes import exchanged_ends, turned_plate
from tests.checks.verbs import contact_rates, contact_state

pytestmark = pytest.mark.jit
PERIODS = 2
AT = State(*range(N_STATE))  # slots of a state by their names
SEED = 27  # of the scenes
SHARES = np.array([0.01, 0.3, 0.7, 0.99])  # of a phase, where it is looked at
accuracies = pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-11])
steady = settings(derandomize=True, max_examples=30, deadline=None)


def between(low, high):
    """Numbers of few digits."""
    return st.integers(0, 2000).map(lambda k: low + (high - low) * k / 2000)


def scene_of(k):
    """A scene of the whole model as a laboratory might build it, and the state that it starts from."""
    row = laboratory_row(k, SEED)
    state = np.zeros(N_STATE)
    begin(dimer_of(row), row, state)
    return dict(zip(ROW, row.tolist(), strict=True)), state


def scenes():
    return st.integers(0, 10 * BLOCK - 1).map(scene_of)


def run_of(scene, state, rtol):
    """Row, dimer and record of a scene from a state."""
    row = Parameters(**scene).row()
    run = launch(row, state, PERIODS, rtol)
    assert run.status == "ok"
    return row, dimer_of(row), run


def steady_run_of(scene, state, rtol):
    """Dimer and run of a scene that does not enlarge rounding: balls that rattle are chaotic, some within two periods."""
    _, dm, run = run_of(scene, state, rtol)
    nudged = state.copy()
    nudged[[AT.ca, AT.cb]] *= 1 + 2**-48
    _, _, other = run_of(scene, nudged, rtol)
    assume((apart(dm, other.state, run.state) <= 1e-8).all())
    return dm, run


def apart(dm, found, expected):
    """Differences of two states in the scales of the scene, angles up to whole turns."""
    change, turned = found - expected, [AT.theta, AT.gamma]
    change[turned] = (change[turned] + pi) % (2 * pi) - pi
    speed = dm.v_scale + (dm.l * dm.g) ** 0.5
    scales = State(*[1.0] * N_STATE)._replace(
        **dict.fromkeys(("d1", "d2", "x1", "y1"), dm.l),
        **dict.fromkeys(("n1", "n2", "ca", "cb", "period"), speed),
        **dict.fromkeys(("wb", "wp"), speed / dm.p2.h),
        spin=speed / dm.p1.r,
    )
    return np.abs(change / scales)


def same(dm, found, expected, allowed=1e-6):
    """Two states agree."""
    far = apart(dm, found, expected)
    assert (far <= allowed).all(), dict(zip(State._fields, far, strict=True))


@accuracies
@steady
@given(scenes(), between(-3.0, 3.0), between(-2.0, 2.0), between(-2.0, 2.0))
def test_heading_and_origin_are_of_no_consequence(rtol, drawn, turn, east, north):
    """Nothing in the plane is special: a turned and shifted start on a turned plate has the turned and shifted run."""
    scene, state = drawn
    dm, run = steady_run_of(scene, state, rtol)
    moved = state.copy()
    moved[[AT.theta, AT.x1, AT.y1]] = state[AT.theta] + turn, east, north
    _, _, other = run_of(scene | turned_plate(scene, turn), moved, rtol)
    expected = run.state.copy()
    c, s = np.cos(turn), np.sin(turn)
    expected[AT.theta] += turn
    x, y = run.state[[AT.x1, AT.y1]]
    expected[[AT.x1, AT.y1]] = east + c * x - s * y, north + s * x + c * y
    same(dm, other.state, expected, 1e-6 if dm.sideways else 1e-9)
    assert dm.sideways or len(other.events) == len(run.events)


@accuracies
@steady
@given(scenes())
def test_mirrored_starts_make_mirrored_runs(rtol, drawn):
    """The plane of Y and the normal is a mirror: lateral velocities and the turning change sign, and so does all along X."""
    scene, state = drawn
    dm, run = steady_run_of(scene, state, rtol)
    lateral = [AT.cb, AT.wp, AT.spin, AT.theta, AT.x1, AT.gamma]
    mirrored = state.copy()
    mirrored[lateral] *= -1
    image = scene | {"azimuth": pi - scene["azimuth"], "phi_x": scene["phi_x"] + pi}
    _, _, other = run_of(image, mirrored, rtol)
    expected = run.state.copy()
    expected[lateral] *= -1
    same(dm, other.state, expected)


def exchanged(dm, state):
    """A motion with the balls' names exchanged: the axis and the heading point the other way."""
    told = state.copy()
    told[[AT.d1, AT.d2, AT.n1, AT.n2]] = state[[AT.d2, AT.d1, AT.n2, AT.n1]]
    told[[AT.dip, AT.wb, AT.ca, AT.cb, AT.spin, AT.gamma]] *= -1
    told[AT.theta] += pi
    lever = dm.l * np.cos(dm.beta_0 + state[AT.dip])
    told[AT.x1] -= lever * np.sin(state[AT.theta])
    told[AT.y1] += lever * np.cos(state[AT.theta])
    return told


@accuracies
@steady
@given(scenes())
def test_the_balls_have_no_names(rtol, drawn):
    """Exchanged balls, each with its own radius, density, restitution, friction and stiffness, make the same motion."""
    scene, state = drawn
    dm, run = steady_run_of(scene, state, rtol)
    _, _, other = run_of(exchanged_ends(scene), exchanged(dm, state), rtol)
    # stiffness counts in units of that of p1: an impact takes other steps, which costs a tolerance that impacts enlarge
    same(dm, other.state, exchanged(dm, run.state), 1e-6 + 1e4 * rtol)


@accuracies
@steady
@given(scenes(), st.sampled_from([1e-3, 0.37, 1e4]))
@example(drawn=scene_of(4485), factor=0.37)  # held at both ends, until the lateral hold of one is lost
def test_mass_is_of_no_consequence(rtol, drawn, factor):
    """All forces grow with the mass: a dimer of a denser kind moves in the same way."""
    scene, state = drawn
    dm, run = steady_run_of(scene, state, rtol)
    denser = {name: factor * scene[name] for name in ("rho_b_1", "rho_b_2", "rho_r")}
    _, _, other = run_of(scene | denser, state, rtol)
    same(dm, other.state, run.state)


@accuracies
@steady
@given(scenes(), between(0.1, 10.0), between(0.1, 10.0))
def test_length_and_gravity_only_set_the_units(rtol, drawn, length, gravity):
    """The similarity law: lengths by L, gravity by G, times by sqrt(L/G), speeds by sqrt(L G)."""
    scene, state = drawn
    _, run = steady_run_of(scene, state, rtol)
    scaled = scene | {name: length * scene[name] for name in ("r_1", "r_2", "D_r")}
    scaled |= {"g": gravity * scene["g"], "f": scene["f"] * (gravity / length) ** 0.5}

    def rescaled(state):
        told = state.copy()
        told[[AT.d1, AT.d2, AT.x1, AT.y1]] *= length
        told[[AT.n1, AT.n2, AT.ca, AT.cb]] *= (length * gravity) ** 0.5
        told[[AT.wb, AT.wp, AT.spin]] *= (gravity / length) ** 0.5
        return told

    _, scaled_dm, other = run_of(scaled, rescaled(state), rtol)
    # other rounding may tip a decision (where a chatter closes) that costs a few tolerances, which impacts enlarge
    same(scaled_dm, other.state, rescaled(run.state), 1e-6 + 1e4 * rtol)


@accuracies
@steady
@given(scenes(), st.sampled_from([1, 7, 1000]))
def test_whole_periods_of_the_phase_are_of_no_consequence(rtol, drawn, turns):
    """A phase at the start that is larger by whole turns, and time that is later by whole periods."""
    scene, state = drawn
    dm, run = steady_run_of(scene, state, rtol)
    _, _, other = run_of(scene | {"phi0": scene["phi0"] + 2 * pi * turns}, state, rtol)
    same(dm, other.state, run.state)


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-11, 1e-13])
@steady
@given(scenes())
@example(drawn=scene_of(727))  # at loose tolerances a sample finds the end of a slip 3e-6 rad before the run
def test_sampling_comes_to_what_the_run_recorded(rtol, drawn):
    """At the end of a phase the sampled state is the one that the next phase starts from; no end is below the plate before."""
    scene, state = drawn
    row, dm, run = run_of(scene, state, rtol)
    phases = phases_of(row, rtol, run.events, run.segments)
    ends = states_at(row, phases.segments, (phases.segments[:, AT.phase] + phases.span)[:, None], rtol)[:, 0]
    assert (ends[:, [AT.d1, AT.d2]] >= -1e-13 * dm.p2.h).all()
    smooth = ~phases.struck & ~phases.closed
    for found, told in zip(ends[smooth], phases.after[smooth], strict=True):
        found[AT.phase], found[AT.period] = told[AT.phase], told[AT.period]
        same(dm, found, told, 100 * max(rtol, 1e-12))


@accuracies
@steady
@given(scenes())
def test_without_loss_and_work_energy_lasts(rtol, drawn):
    """Elastic and smooth on a plate at rest, a dimer hops on with the energy that it had."""
    scene, state = drawn
    smooth = dict.fromkeys(("mu_1", "mu_2", "mu_s_1", "mu_s_2", "mu_h_1", "mu_h_2"), 0.0)
    still = dict.fromkeys(("Gamma", "Gamma_2", "Gamma_x", "Gamma_y"), 0.0)
    _, dm, run = run_of(scene | smooth | still | {"e_1": 1.0, "e_2": 1.0}, state, rtol)
    states = run.segments[:, :N_STATE]
    gained = lab_gain(dm, np.repeat(states[:1], len(states), 0), states)
    assert np.abs(gained).max() <= (1e-10 + (10 + len(states)) * rtol) * total(dm, states).max()  # each impact: `rtol`


# --- balances, event by event -----------------------------------------------------------------------------------------


def momentum(dm, before, after):
    """Impulse on the body (axial, lateral, normal) between two states at one moment, shape (n, 3) [kg m/s]."""
    change = after - before
    return dm.m * np.column_stack(
        [change[:, AT.ca], change[:, AT.cb], of_centre(dm, change[:, AT.n1], change[:, AT.n2])]
    )


@accuracies
@steady
@given(scenes())
def test_impulses_lie_in_the_friction_cone_and_point_up(rtol, drawn):
    scene, state = drawn
    row, dm, run = run_of(scene, state, rtol)
    phases = phases_of(row, rtol, run.events, run.segments)
    impulse = momentum(dm, phases.ends[phases.struck], phases.after[phases.struck])
    sideways = np.hypot(impulse[:, 0], impulse[:, 1])
    unit = dm.m * dm.v_scale
    assert (impulse[:, 2] >= -1e-12 * unit).all()
    most = max(scene["mu_s_1"], scene["mu_s_2"])
    assert (sideways <= most * (1 + 1e-6) * impulse[:, 2] + (1e-9 + rtol) * unit).all()


@accuracies
@steady
@given(scenes())
@example(drawn=scene_of(217))  # an end leaves because the slips turn, while the plate presses the more
@example(drawn=scene_of(5646))  # an end begins to slip, and the other one cannot hold alone
def test_an_end_is_open_or_pressed(rtol, drawn):
    """Complementarity: gaps and forces are never negative, a force acts at gap and gap rate zero only, in its cone."""
    scene, state = drawn
    row, dm, run = run_of(scene, state, rtol)
    phases = phases_of(row, rtol, run.events, run.segments)
    states = states_at(row, phases.segments, phases.segments[:, AT.phase, None] + phases.span[:, None] * SHARES, rtol)
    weight = dm.m * dm.g
    slide, hold = (np.array([scene[f"{name}_1"], scene[f"{name}_2"]]) for name in ("mu", "mu_h"))
    assert states[..., [AT.d1, AT.d2]].min() >= -1e-13 * dm.p2.h
    for segment, at in zip(phases.segments, states, strict=True):
        modes = segment[SEGMENT_MODES:SEGMENT_HOP_TIME]
        closed = modes != FREE
        assert not at[:, [AT.d1, AT.d2]][:, closed].any()
        assert not at[:, [AT.n1, AT.n2]][:, closed].any()
        for now in at if closed.any() else ():
            F, slip = forces(dm, modes, now)
            assert (F[closed, 0] >= -1e-6 * weight).all()
            assert not F[~closed].any()
            if closed.all():  # how the ends share the axial force is undetermined: F holds the sum
                assert (np.abs(F[:, 2]) <= hold * F[:, 0] * (1 + 1e-6) + 1e-6 * weight).all()
                assert np.abs(F[:, 1].sum()) <= hold @ F[:, 0] * (1 + 1e-6) + 1e-6 * weight
                continue
            for i in np.flatnonzero(closed):
                friction, speed = F[i, 1:], np.hypot(*slip[i])
                limit = (hold if modes[i] == STICK else slide)[i]
                assert np.hypot(*friction) <= limit * F[i, 0] * (1 + 1e-6) + 1e-6 * weight
                if modes[i] == SLIP and speed > 1e-6 * dm.v_scale:
                    np.testing.assert_allclose(friction * speed, -slide[i] * F[i, 0] * slip[i], atol=1e-9 * weight)


def forces(dm, modes, state):
    """Forces on the ends (normal, axial, lateral), shape (2, 3) [N], and their slips along the same axes (2, 2) [m/s]."""
    y, dy, F = np.zeros(N_Y), np.zeros(N_Y), np.zeros(N_F)
    contact_state(dm, state, -1.0 if modes[0] != FREE else 1.0, y)
    contact_rates(dm, modes, state[AT.phase] + dm.phi0, y, dy, F)
    slip = slips(dm, state[None])[0]
    if (modes == FREE).any():
        slip[np.flatnonzero(modes != FREE)[0]] = y[Y.u_a], y[Y.u_b]
    return F[:COMPLIANCE].reshape(2, 3), slip


@accuracies
@steady
@given(scenes())
def test_energy_is_accounted_for_event_by_event(rtol, drawn):
    """Flights keep the lab's energy; a contact phase takes the plate's work and friction's, to the accuracy of the run.

    That work comes from a quadrature of known error over the forces along the path of the phase; the run's own states are
    those at its ends.
    """
    scene, state = drawn
    row, dm, run = run_of(scene, state, rtol)
    phases = phases_of(row, rtol, run.events, run.segments)
    starts, modes = phases.segments[:, :N_STATE], phases.segments[:, SEGMENT_MODES:SEGMENT_HOP_TIME]
    unit = kinetic(dm, starts).max() + examine.plate_energy(dm) + dm.m * dm.g * dm.p2.h
    free = (modes == FREE).all(1)
    assert np.abs(lab_gain(dm, starts[free], phases.ends[free])).max(initial=0.0) <= 1e-10 * unit

    def power(states, which):
        """Per rad of the plate's phase."""
        pairs = zip(held[which], states, strict=True)
        return np.array([[power_of(dm, own, now) for now in at] for own, at in pairs]) / dm.omega

    held, closed = modes[~free], max(1e-10, 3 * rtol)
    work, doubt = integrals(row, phases.segments[~free], phases.span[~free], rtol, power, 1e-3 * closed * unit)
    rise = kinetic(dm, phases.ends[~free]) - kinetic(dm, starts[~free])
    assert (np.abs(rise - work) <= closed * unit + 3 * doubt).all()
    # a slip that turns within 1e-6 rad is hard to integrate
    assert doubt.max(initial=0.0) <= max(0.1 * closed, 1e-7) * unit


def power_of(dm, modes, state):
    """Power of effective gravity and friction in the plate's frame [W]; the normal forces have none there."""
    F, slip = forces(dm, modes, state)
    return dm.m * examine.gravity_power(dm, State(*state)) + (F[:, 1:] * slip).sum()


@accuracies
@steady
@given(scenes())
def test_an_impact_does_the_work_of_its_impulses(rtol, drawn):
    """The change of kinetic energy is that of the impulses times the mean velocities of their points."""
    scene, state = drawn
    row, dm, run = run_of(scene, state, rtol)
    phases = phases_of(row, rtol, run.events, run.segments)
    before, after = phases.ends[phases.struck], phases.after[phases.struck]
    unit = kinetic(dm, before) + 0.5 * dm.m * dm.v_scale**2
    impulse = momentum(dm, before, after)
    mean_slip = 0.5 * (slips(dm, before) + slips(dm, after))
    mean_rate = 0.5 * (before + after)[:, [AT.n1, AT.n2]]
    lander = (np.abs(before[:, AT.d2]) < np.abs(before[:, AT.d1])).astype(int)
    n = np.arange(len(before))
    work = impulse[:, 2] * mean_rate[n, lander] + (impulse[:, :2] * mean_slip[n, lander]).sum(1)
    gained = kinetic(dm, after) - kinetic(dm, before)
    alone = np.abs(before[n, AT.d1 + 1 - lander]) > max(1e-9, 0.01 * rtol)  # nearer than that, both are struck
    assert (np.abs(gained - work)[alone] <= max(1e-10, 0.1 * rtol) * unit[alone]).all()
    assert (gained <= 1e-10 * unit).all()
