"""The track of a walk: the velocity of the circle's centre over whole turns; circles, loops, cusps and reversals."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from dimersweep import simulate, sweep
from dimersweep.cubes.cube import names
from dimersweep.kernel.compiler.records import record_type
from dimersweep.kernel.model.layout import TRACKS
from dimersweep.kernel.verdict.settling import SETTLED_PERIODS
from dimersweep.kernel.verdict.track import Fix, TrackState
from tests.checks.verbs import follow_track, track_of

pytestmark = pytest.mark.jit
STEP = 1 / 15  # time between points [s]
TILT = 1e-3


def followed(z, heading):
    """The record of a track of complex places [m], a STEP apart."""
    track = np.zeros(1, record_type(TrackState))[0]
    for k, (place, angle) in enumerate(zip(z, heading, strict=True)):
        follow_track(track, Fix(STEP * k, place.real, place.imag, angle), 1e-3)
    return track


def cycloid(centre_velocity, pace, turns=3.0, radius=4.0, start=0.7, lag=1.6):
    """Places and headings on r = c + U t + R (cos, sin)(theta + lag), theta = start + pace t."""
    t = STEP * np.arange(int(2 * np.pi * turns / abs(pace) / STEP))
    heading = start + pace * t
    return 2 - 1j + centre_velocity * t + radius * np.exp(1j * (heading + lag)), heading


@pytest.mark.parametrize("pace", [0.17, -0.17, 2.9, -11.0])  # the last turns by 0.73 rad a step
@pytest.mark.parametrize("centre_velocity", [0.0, 0.01 - 0.02j, 1.3 + 4j])
def test_the_velocity_of_the_centre_of_a_cycloid_is_exact(pace, centre_velocity):
    track = followed(*cycloid(centre_velocity, pace))
    assert complex(track.u_x, track.u_y) == pytest.approx(centre_velocity, abs=1e-12)


def word(z, heading):
    kind, _, _ = track_of(followed(z, heading), 0.0)
    return TRACKS[kind]


SPEED = 0.17 * 4.0  # of the cycloid about its centre


@pytest.mark.parametrize(
    ("ratio", "wanted"),
    [(0.0, "circle"), (0.009, "circle"), (0.02, "loops"), (0.97, "loops"), (1.0, "cusps"), (1.03, "waves"), (5.0, "waves")],
)  # fmt: skip
def test_circles_loops_cusps_and_waves_by_the_speed_of_the_centre(ratio, wanted):
    """A cycloid has cusps where its centre is as fast as it goes round; a speed of 3 % turns it too slowly for one."""
    assert word(*cycloid(ratio * SPEED * np.exp(0.4j), 0.17)) == wanted


def libration(most, cusped):
    """A heading that swings to and fro by `most`; the dimer walks back where it turns back, or on."""
    t = STEP * np.arange(2000)
    heading = most * np.sin(0.1 * t)
    speed = np.cos(0.1 * t) if cusped else np.ones_like(t)
    return np.cumsum(speed * np.exp(1j * heading)) * STEP, heading


@pytest.mark.parametrize(
    ("most", "cusped", "wanted"), [(1.0, True, "cusps"), (1.0, False, "reversals"), (0.04, False, "straight")]
)
def test_a_heading_that_turns_back(most, cusped, wanted):
    track = followed(*libration(most, cusped))
    assert word(*libration(most, cusped)) == wanted
    assert np.isnan([track.u_x, track.u_y]).all()


def test_a_turn_that_is_not_whole_has_no_velocity():
    z, heading = cycloid(0.1, 0.17, turns=0.97)
    track = followed(z, heading)
    assert track.kind == 0
    assert np.isnan(track.u_x)
    assert word(z, heading) == "arc"


def test_a_turn_after_a_reversal_counts_again():
    back, swung = libration(1.0, True)
    z, heading = cycloid(0.01, -0.17)
    track = followed(np.r_[back, z - z[0] + back[-1]], np.r_[swung, heading - heading[0] + swung[-1]])
    assert TRACKS[int(track.kind)] == "loops"
    assert track.u_x == pytest.approx(0.01, abs=1e-12)


@pytest.fixture(scope="module")
def tilted():
    return simulate(tilt=TILT, periods=1400)


def test_on_a_tilted_plate_the_centre_moves_uphill_as_the_track_says(tilted):
    """Displacement between two moments of one heading, of a spline through the sampled track.

    The first turn begins when the motion is known to have settled, each other one with the period in which the last one ends.
    """
    points = tilted.section()
    heading = -points["theta"].values
    first = int(tilted.settled_after) + SETTLED_PERIODS + tilted.mode_period
    second = np.argmax(heading >= heading[first] + 2 * np.pi)
    assert heading[-1] < heading[second] + 4 * np.pi
    if heading[-1] >= heading[second] + 2 * np.pi:
        first = second
    places = np.column_stack([points["time"], points["x"], points["y"]])
    moved = CubicSpline(heading[30:], places[30:])(heading[first] + 2 * np.pi) - places[first]
    told = [tilted.centre_velocity_x, tilted.centre_velocity_y]
    np.testing.assert_allclose(told, moved[1:] / moved[0], atol=1e-7)
    assert tilted.centre_velocity_x < -0.01  # the plate falls towards +x
    assert tilted.mode == "drift"
    assert tilted.track == "loops"


def test_the_centre_moves_in_proportion_to_the_tilt_and_turns_with_its_azimuth(tilted):
    uphill = complex(tilted.centre_velocity_x, tilted.centre_velocity_y)
    gentle = simulate(tilt=0.1 * TILT, azimuth=1.0, theta0=0.3, periods=1400, record=False)
    assert gentle.track == "circle"  # it moves by 0.16 % of the path
    velocity = complex(gentle.centre_velocity_x, gentle.centre_velocity_y) * np.exp(-1j)
    assert velocity == pytest.approx(0.1 * uphill, abs=2e-3 * abs(uphill))


def test_unrecorded_and_in_two_parts_it_is_the_same(tilted):
    whole = simulate(tilt=TILT, periods=1400, record=False)
    parts = simulate(tilt=TILT, periods=500, record=False).go_on(900)
    for run in (whole, parts):
        assert (run.track, run.centre_velocity_x, run.centre_velocity_y) == (
            tilted.track, tilted.centre_velocity_x, tilted.centre_velocity_y,
        )  # fmt: skip


def test_on_a_steep_plate_the_walk_reverses_in_cusps():
    run = simulate(tilt=0.02, periods=700)
    assert run.track == "cusps"
    assert np.isnan(run.centre_velocity_x)
    points = run.section()
    turned = np.diff(points["theta"].values[30:])
    assert turned.min() < 0 < turned.max()  # the heading has turned back
    velocity = np.diff(points["x"].values[30:] + 1j * points["y"].values[30:])
    bends = np.abs(np.angle(velocity[1:] / velocity[:-1]))
    assert (bends > np.pi / 2).any()


def test_on_a_level_plate_the_centre_stands():
    whole, stopped, short = (
        simulate(periods=periods, record=False, stop_when_settled=settle)
        for periods, settle in ((700, False), (700, True), (100, False))
    )
    for run in (whole, stopped):
        assert (run.track, run.centre_velocity_x, run.centre_velocity_y) == ("circle", 0.0, 0.0)
    assert stopped.n_periods < 500  # it would have made a whole turn in those asked for
    assert short.track == "arc"
    assert np.isnan(short.centre_velocity_x)
    assert simulate(xdot0=0.0, periods=100, record=False).track == "straight"
    assert simulate(Gamma=0.5, periods=100, record=False).track == "none"


@pytest.mark.parametrize("scene", [{}, {"f": 30.0, "xdot0": 3.0}, {"Gamma": 1.2, "beta0": 0.8, "xdot0": 0.5}], ids=str)
@pytest.mark.parametrize("periods", [80, 300, 1000])
def test_the_track_of_a_stopped_run_is_that_of_the_whole_one(periods, scene):
    whole, stopped = (
        simulate(**scene, periods=periods, record=False, stop_when_settled=settle) for settle in (False, True)
    )
    assert stopped.n_periods < periods
    assert (stopped.mode, stopped.track) == (whole.mode, whole.track)


def test_a_cube_tells_the_velocity_of_the_centre():
    cube = sweep({"tilt": [0.0, TILT, 0.02]}, periods=1400, progress=False)
    assert names(cube["track"]).values.tolist() == ["circle", "loops", "cusps"]
    assert cube["centre_velocity_x"].values[:2] == pytest.approx([0, -0.0116], abs=1e-4)
    assert np.isnan(cube["centre_velocity_x"].values[2])
    assert cube["centre_velocity_y"].attrs["units"] == "m s-1"
