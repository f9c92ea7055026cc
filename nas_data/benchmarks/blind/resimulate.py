"""Playing fresh episodes on a delivered model in plain MuJoCo, as anyone could who has only the file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from nas_data.dataset.features import POSITION
from nas_data.errors import JointMismatch, ModelFileError
from nas_data.simulators.controls import find_length_control
from nas_data.simulators.rest_states import settle_actuator

SENSOR = ".pos"


@dataclass(frozen=True)
class Delivered:
    """A model as it was delivered."""

    model: mujoco.MjModel  # compiled
    rate: float  # control rate [Hz]
    actuators: tuple[int, ...]  # index of each joint's actuator
    sensors: tuple[int, ...]  # where each joint's measured position lies among the sensors
    # places in `qpos` that start at the first measured position: the joint's, and what its servo drives
    rests: tuple[tuple[int, ...], ...]
    moving: tuple[int, ...]  # place in `qvel` of each joint

    @classmethod
    def load(cls, file: Path, joints: Sequence[str], actuators: Sequence[str], rate: float) -> "Delivered":
        """Load a model and find what the contract promises in it.

        Args:
            file: MJCF.
            joints: Names of the measured joints.
            actuators: Names of their actuators in the nominal model.
            rate: Control rate [Hz].

        Raises:
            ModelFileError: it does not load, or lacks a joint, an actuator or a sensor that it must keep.
        """
        try:
            model = mujoco.MjModel.from_xml_path(str(file))
        except ValueError as error:
            raise ModelFileError(f"{file} does not load in plain MuJoCo: {error}") from None
        return cls.of(model, joints, actuators, rate, file)

    @classmethod
    def of(
        cls, model: mujoco.MjModel, joints: Sequence[str], actuators: Sequence[str], rate: float, file: Path
    ) -> "Delivered":
        """Find the same in a compiled model; the file is for errors alone."""
        model.opt.timestep = 1 / rate / int(np.ceil(1 / rate / model.opt.timestep - 1e-6))
        servos = tuple(find(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name, file) for name in actuators)
        sensors = [find(model, mujoco.mjtObj.mjOBJ_SENSOR, joint + SENSOR, file) for joint in joints]
        hinges = [find(model, mujoco.mjtObj.mjOBJ_JOINT, joint, file) for joint in joints]
        places = [int(model.jnt_qposadr[hinge]) for hinge in hinges]
        driven = [find_qpos_index(model, servo) for servo in servos]
        rests = tuple(tuple({own, *other}) for own, other in zip(places, driven, strict=True))
        moving = tuple(int(model.jnt_dofadr[hinge]) for hinge in hinges)
        return cls(model, rate, servos, tuple(int(model.sensor_adr[sensor]) for sensor in sensors), rests, moving)

    def play(self, commands: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Return `<joint>.pos` after each command.

        Args:
            commands: Commanded positions [rad] or torques [N m], shape (E, T, n).
            first: Positions [rad], then speeds [rad/s] with which each episode starts, shape (E, 2n); until then the
                command was held at those positions, or no torque was told.

        Returns:
            Positions [rad], shape (E, T, n); NaN from where a simulation left all bounds.
        """
        return np.stack([self._simulate_episode(*pair) for pair in zip(commands, first, strict=True)])

    def _simulate_episode(self, commands: np.ndarray, first: np.ndarray) -> np.ndarray:
        model, data = self.model, mujoco.MjData(self.model)
        controls = model.actuator_ctrladr[list(self.actuators)]
        positions, speeds = np.split(first, 2)
        data.ctrl[controls] = np.where(
            [find_length_control(model, servo).kind == POSITION for servo in self.actuators], positions, 0.0
        )
        for places, position in zip(self.rests, positions, strict=True):
            data.qpos[list(places)] = position
        data.qvel[list(self.moving)] = speeds
        for actuator in range(len(model.actuator_trntype)):
            settle_actuator(model, data, actuator)
        substeps = round(1 / self.rate / model.opt.timestep)
        shown = np.full(commands.shape, np.nan)
        for step, command in enumerate(commands):
            data.ctrl[controls] = command
            mujoco.mj_step(model, data, substeps)
            if abs(data.time - (step + 1) / self.rate) > 0.5 / self.rate:  # the engine starts over after a divergence
                break
            mujoco.mj_fwdPosition(model, data)  # a step leaves the sensors of its beginning
            mujoco.mj_sensorPos(model, data)
            shown[step] = data.sensordata[list(self.sensors)]
        return shown


def find(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str, file: Path) -> int:
    """Return the index of a named thing."""
    index = int(mujoco.mj_name2id(model, kind, name))
    if index < 0:
        raise ModelFileError(
            f"{file} has no '{name}' ({kind.name}); a delivered model keeps joints, actuators, sensors."
        )
    return index


def find_qpos_index(model: mujoco.MjModel, actuator: int) -> tuple[int, ...]:
    """Return the place in `qpos` of the joint that an actuator drives, which may be a goal beside the arm."""
    if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_JOINT):
        return ()
    return (int(model.jnt_qposadr[model.actuator_trnid[actuator, 0]]),)


def find_actuators(file: Path, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the actuators that drive the joints of a nominal model.

    Raises:
        JointMismatch: a joint has no named actuator.
    """
    spec = mujoco.MjSpec.from_file(str(file))
    names = {actuator.target: actuator.name for actuator in spec.actuators}
    if missing := [joint for joint in joints if not names.get(joint)]:
        raise JointMismatch(f"{file} has no named actuator for the joint '{missing[0]}'.")
    return tuple(names[joint] for joint in joints)
