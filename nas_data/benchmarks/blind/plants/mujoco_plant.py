"""Plant in MuJoCo with this project's own effects: a deliberate inverse crime, for comparison only."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Base, Truth
from nas_data.benchmarks.blind.plants.base import Feedback, Play
from nas_data.effects.base import make_effect
from nas_data.robots.base import Robot
from nas_data.simulators.mujoco import MujocoSimulator


def simulate(
    arm: NominalArm,
    truths: Sequence[Truth],
    commands: np.ndarray,
    starts: np.ndarray,
    period: float,
    feedback: Feedback | None,
) -> np.ndarray:
    """Return states (C, E, T + 1, 2n) under each truth; implements `Simulate`.

    Raises:
        UnknownName: a truth hides something outside the contract's table.
    """
    built = [build(arm, truth, period) for truth in truths]
    if feedback is None:
        played = np.stack([simulator.rollout(starts, commands) for simulator in built])
    else:
        played = np.stack([roll_out_closed_loop(simulator, starts, commands.shape[1], feedback) for simulator in built])
    first = np.broadcast_to(starts[:, None], (len(truths), len(starts), 1, starts.shape[1]))
    return np.concatenate([first, played[..., : starts.shape[1]]], axis=2)


play = Play(simulate)


def roll_out_closed_loop(simulator: MujocoSimulator, starts: np.ndarray, steps: int, feedback: Feedback) -> np.ndarray:
    """Return states (E, T, 2n) after each of T control periods with commands from feedback."""
    stepper, states, rows = simulator.stepper(len(starts)), starts, []
    stepper.reset(starts)
    for step in range(steps):
        states = stepper.step(feedback(step, states))
        rows.append(states)
    return np.stack(rows, axis=1)


def build(arm: NominalArm, truth: Truth, period: float) -> MujocoSimulator:
    """Return a single-threaded simulator of the arm with its base errors and effects."""
    effects = [make_effect(hidden.effect, hidden.joint, hidden.parameters) for hidden in truth.hidden]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.xml"
        file.write_text(arm.xml, encoding="utf-8")
        robot = Robot(arm.name, file, arm.joints, edit=lambda spec: multiply(spec, arm.joints, truth.base))
        return MujocoSimulator(robot, period, effects=effects, threads=1)


def multiply(spec: mujoco.MjSpec, joints: Sequence[str], base: Base) -> None:
    """Multiply the model's parameters of each joint by its base factors."""
    for row, name in enumerate(joints):
        joint = spec.joint(name)
        servo = next(actuator for actuator in spec.actuators if actuator.target == name)
        joint.damping = joint.damping * base.damping[row]
        joint.armature *= base.armature[row]
        gain, bias = servo.gainprm.copy(), servo.biasprm.copy()
        gain[0], bias[1] = gain[0] * base.stiffness[row], bias[1] * base.stiffness[row]
        bias[2] *= base.damping[row]
        servo.gainprm, servo.biasprm = gain, bias
        for geom in joint.parent.geoms:
            geom.mass *= base.mass[row]
