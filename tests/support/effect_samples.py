"""A servo on one joint, as a model and written down in NumPy at a fine step to judge it."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.effects.base import Effect, make_effect
from nas_data.robots.base import Robot
from nas_data.simulators.mujoco import MujocoSimulator

PERIOD = 0.01
FINE = 1e-4  # [s] step of the written-down servo

TIMES = PERIOD * np.arange(300)
SIGNALS = {
    "ramp": 0.2 * TIMES,
    "triangle": 0.6 * np.abs((TIMES / 3 + 0.5) % 1 * 2 - 1) - 0.3,
    "sine": 0.4 * np.sin(2 * np.pi * TIMES),
    "holds": np.repeat(np.random.default_rng(0).uniform(-0.9, 0.9, 6), 50),
}

LEVER = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{timestep}" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body>
      <joint name="j" axis="0 0 1" armature="{inertia}" damping="{damping}" frictionloss="{friction}"
             solimpfriction="0.99 0.99 0.001" solreffriction="{twice} 1"/>
      <geom size="0.001" mass="1e-6"/>
    </body>
  </worldbody>
  <actuator>
    <position name="j" joint="j" kp="{kp}" kv="{kv}" forcelimited="true" forcerange="-{limit} {limit}"/>
  </actuator>
</mujoco>
"""


@dataclass(frozen=True, kw_only=True)
class Lever:
    """One joint and its servo, sized like an XL-320 with a link; units as in MuJoCo."""

    inertia: float = 0.0016
    damping: float = 0.03
    friction: float = 0.0275
    kp: float = 0.336
    kv: float = 0.0
    limit: float = 0.208

    def spec(self, timestep: float = 0.002) -> mujoco.MjSpec:
        """Return the lever as an editable model."""
        numbers = {**vars(self), "timestep": timestep, "twice": 2 * timestep}
        return mujoco.MjSpec.from_string(LEVER.format(**numbers))

    def move(
        self,
        commands: np.ndarray,
        load: float = 0.0,
        ignored: float = 0.0,
        friction: Callable[[float, float], float] = lambda speed, torque: 0.0,
    ) -> np.ndarray:
        """Return angles [rad] after each command, held for PERIOD, with friction that truly sticks.

        Args:
            commands: Angles [rad], shape (T,).
            load: Torque on the joint [N·m].
            ignored: Half width of the servo's dead band [rad].
            friction: Friction [N·m] beyond the lever's own at a speed [rad/s] and a servo's torque [N·m].
        """
        angle, speed, angles = 0.0, 0.0, []
        mass = self.inertia + FINE * self.damping
        for command in commands:
            for _ in range(round(PERIOD / FINE)):
                error = command - angle
                felt = error - min(max(error, -ignored), ignored)
                torque = min(max(self.kp * felt - self.kv * speed, -self.limit), self.limit)
                bound = self.friction + friction(speed, torque)
                stopping = self.inertia * speed / FINE + torque + load
                speed = FINE * (stopping - min(max(stopping, -bound), bound)) / mass
                angle += FINE * speed
            angles.append(angle)
        return np.array(angles)


def effect(name: str, **values: float) -> Effect:
    return make_effect(name, "j", values)


def simulator(tmp_path, lever: Lever, *effects: Effect) -> MujocoSimulator:
    file = tmp_path / "lever.xml"
    file.write_text(lever.spec().to_xml())
    return MujocoSimulator(Robot(name="lever", mjcf=file, joints=("j",)), PERIOD, effects=effects, threads=1)


def simulate(tmp_path, lever: Lever, commands: np.ndarray, *effects: Effect) -> np.ndarray:
    return simulator(tmp_path, lever, *effects).rollout(np.zeros((1, 2)), commands[None, :, None])[0, :, 0]


def rms_degrees(difference: np.ndarray) -> float:
    return float(np.degrees(np.sqrt(np.mean(difference**2))))
