"""Keyframes of a model to which effects add joints and actuator states."""

import mujoco
import numpy as np

from nas_data.mjcf.actuator_lookup import GOAL, find_goal_joints


def keep_keyframes(spec: mujoco.MjSpec, before: mujoco.MjModel) -> None:
    """Rewrite the keyframes; added joints are at their reference, and goals of servos at their joints.

    Args:
        spec: Model with effects, which is edited.
        before: Compiled model without effects.
    """
    if not spec.keys:
        return
    after = spec.compile()
    positions, speeds = find_kept_joints(before, after)
    for number, key in enumerate(spec.keys):
        qpos, qvel = after.qpos0.copy(), np.zeros(after.nv)
        qpos[positions], qvel[speeds] = before.key_qpos[number], before.key_qvel[number]
        for goal in find_goal_joints(after):
            own = after.joint(after.joint(goal).name.removesuffix(GOAL))
            qpos[after.jnt_qposadr[goal]] = qpos[own.qposadr[0]]
        key.qpos, key.qvel = qpos, qvel
        key.act = keep_activations(before, after, number)


def find_kept_joints(before: mujoco.MjModel, after: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the addresses of the original joints in `qpos` and `qvel` of the model with effects."""
    names = {before.joint(joint).name for joint in range(before.njnt)}
    kept = [joint for joint in range(after.njnt) if after.joint(joint).name in names]  # unnamed ones are the model's
    ends = [*after.jnt_qposadr[1:], after.nq], [*after.jnt_dofadr[1:], after.nv]
    positions = [index for joint in kept for index in range(after.jnt_qposadr[joint], ends[0][joint])]
    speeds = [index for joint in kept for index in range(after.jnt_dofadr[joint], ends[1][joint])]
    return np.array(positions, int), np.array(speeds, int)


def keep_activations(before: mujoco.MjModel, after: mujoco.MjModel, number: int) -> np.ndarray:
    """Return the actuator states of a keyframe; new states equal the control."""
    memories = np.zeros(after.na)
    for actuator in range(before.nactuator):
        first, own = int(after.actuator_actadr[actuator]), int(before.actuator_actadr[actuator])
        if own >= 0:
            count = int(before.actuator_actnum[actuator])
            memories[first : first + count] = before.key_act[number, own : own + count]
        elif first >= 0:
            memories[first] = before.key_ctrl[number, before.actuator_ctrladr[actuator]]
    return memories
