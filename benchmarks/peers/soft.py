"""MuJoCo: the dimer as one body with two spheres on a plane, in the frame of the plate.

In that frame the plate rests and its motion is a force on the centre of mass, exactly, so that a contact sees the true
relative velocity. The contact is soft: a spring and damper whose damping gives the restitution of the scene, as stiff as the
time step allows.
"""

from math import atan2, exp, pi, sqrt

import mujoco
import numpy as np
from mujoco import rollout
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from tests.oracle.body import DEFAULTS, dimer

STEPS_A_CONTACT = 20
PIECE = 100_000  # steps kept at once
MODEL = """
<mujoco>
  <option timestep="{dt}" gravity="0 0 -{g}" integrator="implicitfast" cone="elliptic" impratio="10"/>
  <default>
    <geom condim="3" friction="{mu} 0 0" solref="{time} {damping}" solimp="0.99 0.99 0.001"/>
  </default>
  <worldbody>
    <geom type="plane" size="10 10 1"/>
    <body>
      <freejoint/>
      <inertial pos="0 0 0" mass="{m}" diaginertia="{J_t} {J_a} {J_t}"/>
      <geom type="sphere" size="{r}" pos="0 -{h} 0"/>
      <geom type="sphere" size="{r}" pos="0 {h} 0"/>
      <geom type="cylinder" size="0.002 {h}" euler="90 0 0" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>
"""


def restitution(damping):
    """Restitution of a spring and damper that cannot pull (Schwager and Poeschel, doi 10.1007/s10035-007-0065-z)."""
    root = sqrt(1.0 - damping**2)
    return exp(-damping / root * (pi - atan2(2.0 * damping * root, 1.0 - 2.0 * damping**2)))


class MuJoCo:
    """MuJoCo at one time step."""

    copies = 1

    def __init__(self, scene, dt):
        self.d = d = dimer(scene)
        self.scene, self.dt = DEFAULTS | scene, dt
        damping = brentq(lambda ratio: restitution(ratio) - sum(d.e) / 2, 1e-6, 0.99)
        # half a swing of the spring and damper lasts pi time damping
        time = STEPS_A_CONTACT * dt / (pi * damping)
        text = MODEL.format(
            dt=dt, g=d.g, mu=d.mu[0], time=time, damping=damping, m=d.m, J_t=d.J1, J_a=d.J2, r=d.r[0], h=d.l / 2
        )
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)

    def start(self):
        """Full state at the release: p1 on the plate, the axis along Y."""
        d, data = self.d, self.data
        mujoco.mj_resetData(self.model, data)
        turn = Rotation.from_euler("X", self.scene["beta0"])
        data.qpos[:3] = turn.apply([0, d.l / 2, 0])
        data.qpos[2] += d.r[0]
        data.qpos[3:] = turn.as_quat(scalar_first=True)
        data.qvel[:] = 0
        data.qvel[[0, 2]] = self.scene["xdot0"], -d.A[2] * d.omega * np.cos(d.phi[2])
        state = np.empty(mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(self.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state

    def pieces(self, end):
        """Positions and velocities after every time step to `end`, in pieces of shape (n, 13)."""
        d, state, steps = self.d, self.start(), round(end / self.dt)
        for first in range(0, steps, PIECE):
            middle = self.dt * (np.arange(first, min(first + PIECE, steps)) + 0.5)
            force = np.zeros((middle.size, self.model.nbody, 6))
            force[:, 1, 2] = d.m * d.A[2] * d.omega**2 * np.sin(d.omega * middle + d.phi[2])
            states, _ = rollout.rollout(
                self.model,
                self.data,
                state[None],
                force.reshape(1, middle.size, -1),
                control_spec=mujoco.mjtState.mjSTATE_XFRC_APPLIED,
            )
            state = states[0, -1].copy()
            yield states[0, :, 1:14]

    def follow(self, times):
        """States and times of double impacts."""
        at = np.round(np.asarray(times) / self.dt).astype(int) - 1
        first, kept, landings = 0, [], []
        for piece in self.pieces(times[-1]):
            kept.append(piece[at[(at >= first) & (at < first + len(piece))] - first])
            landings.append(self.dt * (first + 1 + self.landings(piece)))
            first += len(piece)
        return self.coordinates(np.concatenate(kept)), np.concatenate(landings)

    def run(self, end):
        """One run."""
        for _ in self.pieces(end):
            pass

    def coordinates(self, path):
        """The coordinates of the reference runs and their rates, shape (n, 12)."""
        h, r = self.d.l / 2, self.d.r[0]
        turn = Rotation.from_quat(path[:, 3:7], scalar_first=True)
        theta, beta, gamma = turn.as_euler("ZXY").T
        axis, spin = turn.apply([0, 1, 0]), turn.apply(path[:, 10:13])
        ball, velocity = path[:, :3] - h * axis, path[:, 7:10] - h * np.cross(spin, axis)
        lateral = np.column_stack([np.cos(theta), np.sin(theta), 0 * theta])
        turning = np.sum(spin * np.cross(lateral, axis), axis=1) / np.cos(beta)
        tipping = np.sum(spin * lateral, axis=1)
        rolling = np.sum(spin * axis, axis=1) - turning * np.sin(beta)
        gap = ball[:, 2] - r
        return np.column_stack([ball[:, 0], ball[:, 1], gap, theta, beta, gamma, velocity, turning, tipping, rolling])

    def landings(self, path):
        """Steps in which one end comes down to the plate while the other is there."""
        rise = self.d.l / 2 * Rotation.from_quat(path[:, 3:7], scalar_first=True).apply([0, 1, 0])[:, 2]
        down = path[:, 2, None] + np.column_stack([-rise, rise]) <= self.d.r[0]
        lands = down[1:] & ~down[:-1]
        return 1 + np.flatnonzero((lands[:, 0] & down[1:, 1]) | (lands[:, 1] & down[1:, 0]))
