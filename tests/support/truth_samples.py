"""Noise-free recordings of the small models in `models/`, made by plain MuJoCo in one uninterrupted simulation."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import ACTION, NEXT_STATE, STATE, make_action_feature, make_state_feature
from nas_data.robots.base import find_robot

FOLDER = Path(__file__).with_name("model_files")
PERIOD = 0.02  # [s]
HELD = 15  # control steps for which a command is held


ASSEMBLED = {"finger_pair": {"mirror": 0.02}, "gripper": {"mirror": 0.05}}  # [rad]


def model_name(model: mujoco.MjModel) -> str:
    """Return a compiled model's name."""
    return model.names.split(b"\0", 1)[0].decode()


def joined_ranges(model: mujoco.MjModel, actuators: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest controls, ±1 where an actuator has none, shape (n,) each."""
    places = model.actuator_ctrladr[list(actuators)]
    limited = model.actuator_ctrllimited[places].astype(bool)
    ranges = np.where(limited[:, None], model.actuator_ctrlrange[places], [-1.0, 1.0])
    return ranges[:, 0], ranges[:, 1]


def record_truth(
    model: mujoco.MjModel, joints: Sequence[str], kinds: Sequence[str], scale: float = 1.0, episodes: int = 3
) -> Dataset:
    """Record episodes that begin in the reference posture; what is told to have been commanded is scale · control.

    Joints in `ASSEMBLED`, whose constraints are not met there, begin where they are.
    """
    model.opt.timestep, steps = 0.002, 10
    places = [model.joint(joint) for joint in joints]
    q, v = ([int(getattr(place, name)[0]) for place in places] for name in ("qposadr", "dofadr"))
    driver = {int(model.actuator_trnid[a, 0]): a for a in reversed(range(model.nactuator))}
    actuators = [driver[place.id] for place in places]
    low, high = joined_ranges(model, actuators)
    rng, states, commands, after = np.random.default_rng(0), [], [], []
    for _ in range(episodes):
        data = mujoco.MjData(model)
        for joint, position in ASSEMBLED.get(model_name(model), {}).items():
            data.joint(joint).qpos = position
        for row in range(60):
            if row % HELD == 0:
                control = rng.uniform(low, high).astype(np.float32)
            states.append([*data.qpos[q], *data.qvel[v]])
            data.ctrl[model.actuator_ctrladr[actuators]] = control
            mujoco.mj_step(model, data, steps)
            commands.append(scale * control)
            after.append([*data.qpos[q], *data.qvel[v]])
    state = make_state_feature(joints)
    return Dataset(
        features={STATE: state, ACTION: make_action_feature(joints, kinds), NEXT_STATE: state},
        columns={STATE: np.array(states), ACTION: np.array(commands), NEXT_STATE: np.array(after)},
        lengths=np.full(episodes, 60),
        fps=1 / PERIOD,
    )


def without_bases(path: Path) -> mujoco.MjModel:
    """Return a model as it hangs in the air: its free joints welded, by MuJoCo alone; a URDF with its motors."""
    spec = find_robot(path).spec() if path.suffix == ".urdf" else mujoco.MjSpec.from_file(str(path))
    free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if free and not spec.equalities:
        for key in list(spec.keys):
            spec.delete(key)
        for joint in free:
            spec.delete(joint)
    return spec.compile()
