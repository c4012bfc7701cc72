"""Scenes in which the engine and the slow oracle are compared: random ones, and the coordinates they share."""

from cmath import phase, rect
from math import cos, pi, sin

import numpy as np

from dimersweep import names, simulate
from dimersweep.kernel.model.layout import HARMONICS, WAVES
from dimersweep.parameters import updated, without_effect
from dimersweep.symbols import ENDS

SCALE = np.array([0.01, 0.01, 0.01, 1, 1, 10, 0.1, 0.1, 0.1, 1, 1, 100])
COORDINATES = ("x1", "y1", "gap_1", "theta", "beta", "gamma")
COLUMNS = COORDINATES + tuple(f"{name}_rate" for name in COORDINATES)
# units in which differences of two runs count, of quantities of `Run.states`
UNITS = dict(zip(COLUMNS, SCALE.tolist(), strict=True)) | {"x": 0.01, "y": 0.01, "gap_2": 0.01, "gap_2_rate": 0.1}


def random_scene(seed):
    """Parameters of one random scene: every second one with a feature that the base case lacks."""
    rng = np.random.default_rng([20240301, seed])
    mu = float(rng.uniform(0.03, 0.6))
    scene = {
        "e": float(rng.uniform(0.2, 0.85)),
        "Gamma": float(rng.uniform(0.2, 1.7)),
        "f": float(rng.uniform(10, 35)),
        "A_r": float(rng.uniform(2.5, 8)),
        "mu": mu,
        "mu_s": mu * float(rng.choice([1.0, 1.4, 2.0])),
        "beta0": float(rng.uniform(0.02, 0.7)),
        "xdot0": float(rng.choice([0.2, 1.0, 2.0]) * rng.uniform(0.5, 1)),
    }
    features = [
        {"phi0": float(rng.uniform(0, 2 * pi))},
        {"e_1": float(rng.uniform(0.2, 0.8)), "e_2": float(rng.uniform(0.2, 0.8))},
        {"xdot0": 0.0},
        {"r": 3e-3, "rho_b": 2500.0, "rho_r": 2700.0, "D_r": 5e-3},
        {"e": 0.0},
        {"mu": 0.0, "mu_s": 0.0},
        {"Gamma": 0.0},
    ]
    return updated(scene, features[seed // 2 % len(features)] if seed % 2 else {})


def sample_times(scene, periods=3):
    """Two times a period, the boundaries included."""
    return np.arange(1, 2 * periods + 1) / (2 * scene["f"])


def engine_states(scene, times, rtol):
    """States of the engine in the oracle's coordinates, shape (n, 12), and the times of the double impacts."""
    scene = {name: value for name, value in scene.items() if name not in without_effect(scene)}
    run = simulate(**scene, periods=int(np.ceil(times[-1] * scene["f"] - 1e-9)), rtol=rtol)
    assert run.status == "ok", run.message
    states = run.states(times)
    events = names(run.events)
    double = np.char.startswith(events["kind"].values, "DI")
    starts = events["time"].values[double]
    return np.column_stack([states[name] for name in COLUMNS]), starts[np.diff(starts, prepend=-1.0) > 1e-12]


def difference(states, expected):
    """Largest difference of two sets of states in units of SCALE; the spin angle counts up to whole turns."""
    apart = states - expected
    apart[:, 5] = (apart[:, 5] + pi) % (2 * pi) - pi
    return float((np.abs(apart) / SCALE).max())


def wider_scene(seed):
    """A random scene whose plate has a second harmonic, or whose lasting contacts are held by a coefficient of their own."""
    scene, rng = random_scene(seed), np.random.default_rng([20240302, seed])
    if seed % 3 != 1:
        scene |= {"Gamma_2": float(rng.uniform(0.05, 1.2)), "phi_2": float(rng.uniform(0, 2 * pi))}
    if seed % 3 != 0:
        scene |= {"mu_h": scene["mu"] * float(rng.choice([1.0, 1.2, 1.7, 3.0]))}
    return scene


def started_scene(seed):
    """A general scene that starts over the plate, and turns about every axis."""
    scene, rng = general_scene(seed), np.random.default_rng([20240304, seed])
    fastest = {"ydot0": 1.0, "betadot0": 5.0, "thetadot0": 5.0, "gammadot0": 150.0}
    scene |= {name: float(rng.uniform(-most, most)) for name, most in fastest.items()}
    return scene | {"gap0": float(rng.choice([0.0, rng.uniform(0, 5e-3)]))}


def general_scene(seed):
    """A wider scene with unlike ends, another contact, and in turn a plate that is tilted, that moves along itself, or both."""
    scene, rng = wider_scene(seed), np.random.default_rng([20240303, seed])
    r, rho_b = scene.pop("r", 5e-3), scene.pop("rho_b", 7850.0)
    usual = {"r": r, "rho_b": rho_b} | {name: scene.pop(name) for name in ("mu", "mu_s", "mu_h") if name in scene}
    for i in (1, 2):
        rougher = float(rng.uniform(0.7, 1.4))
        share = {"r": float(rng.uniform(0.8, 1.25)), "rho_b": float(rng.uniform(0.5, 2))}
        scene |= {f"{name}_{i}": value * share.get(name, rougher) for name, value in usual.items()}
    scene |= {
        "eta": float(rng.uniform(1, 2)),
        "k_ratio": float(rng.uniform(0.5, 2)),
        "theta0": float(rng.uniform(0, 2 * pi)),
    }
    if rng.random() < 0.5:
        scene["beta0"] *= -1
    if seed % 3 != 1:
        scene |= {"tilt": float(rng.uniform(0, 0.06)), "azimuth": float(rng.uniform(0, 2 * pi))}
    if seed % 3 != 0:
        for axis in "xy":
            scene |= {f"Gamma_{axis}": float(rng.uniform(0, 0.3)), f"phi_{axis}": float(rng.uniform(0, 2 * pi))}
    return scene


def sawtooth_scene(seed):
    """A general scene whose plate moves as a saw-tooth of all harmonics along its normal, and by some of them along itself."""
    scene, rng = general_scene(seed), np.random.default_rng([20261127, seed])
    for k, (Gamma, phi) in enumerate(WAVES[0][1:], start=2):
        scene |= {Gamma: scene["Gamma"] / k, phi: float(k * scene.get("phi0", 0.0) + pi * (k + 1))}
    for k in rng.choice(np.arange(2, HARMONICS + 1), 3, replace=False):
        Gamma, phi = WAVES[1 + int(rng.integers(2))][k - 1]
        scene |= {Gamma: float(rng.uniform(0, 0.1)), phi: float(rng.uniform(0, 2 * pi))}
    return scene


def exchanged_ends(scene):
    """A scene with the parameters of its ends exchanged."""
    other = {one: two for ends in ENDS.values() for one, two in (ends, ends[::-1])}
    return {other.get(name, name): value for name, value in scene.items()} | {"k_ratio": 1 / scene["k_ratio"]}


def turned_plate(scene, angle):
    """Parameters of the tilt and of the motion along the plate of a scene, turned about the normal."""
    along = {axis: rect(scene.get(f"Gamma_{axis}", 0.0), scene.get(f"phi_{axis}", 0.0)) for axis in "xy"}
    x, y = along["x"] * cos(angle) - along["y"] * sin(angle), along["x"] * sin(angle) + along["y"] * cos(angle)
    shaken = {"Gamma_x": abs(x), "phi_x": phase(x), "Gamma_y": abs(y), "phi_y": phase(y)}
    return shaken | {"azimuth": scene.get("azimuth", 0.0) + angle}
