"""Play fresh episodes on a delivered model in plain MuJoCo, without this package's simulator, and score it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from nas_data.benchmarks.blind.case import SealedAnswer
from nas_data.benchmarks.blind.plants.mujoco_plant import multiply
from nas_data.benchmarks.blind.write import FRESH, NOMINAL
from nas_data.dataset.features import POSITION
from nas_data.effects.base import Effect, Scales, add_effects, find_joint_actuator, make_effect
from nas_data.effects.edits.series import ensure_measured_tendon
from nas_data.effects.edits.servo import read_force_range, read_servo_stiffness
from nas_data.errors import JointMismatch, ModelFileError, NasError, UnknownName
from nas_data.simulators.controls import find_length_control
from nas_data.simulators.rest_states import settle_actuator

SENSOR = ".pos"


@dataclass(frozen=True)
class Delivered:
    """A model file delivered by a workflow."""

    model: mujoco.MjModel  # compiled
    rate: float  # control rate [Hz]
    actuators: tuple[int, ...]  # index of each joint's actuator
    sensors: tuple[int, ...]  # index in `sensordata` of each joint's measured position
    # indices in `qpos` that start at the first measured position: the joint's, and what its servo drives
    rests: tuple[tuple[int, ...], ...]
    moving: tuple[int, ...]  # index in `qvel` of each joint

    @classmethod
    def load(cls, file: Path, joints: Sequence[str], actuators: Sequence[str], rate: float) -> "Delivered":
        """Load a model and find the joints, actuators and sensors that the contract requires.

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
        """Find them in a compiled model; `file` is used in errors only."""
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
        """Simulate commands and return `<joint>.pos` after each.

        Args:
            commands: Commanded positions [rad] or torques [N m], shape (E, T, n).
            first: Initial positions [rad], then speeds [rad/s], shape (E, 2n). Commands before the episode are taken to
                be those positions, or zero torque.

        Returns:
            Positions [rad], shape (E, T, n); NaN from the step at which a simulation diverged.
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
            if abs(data.time - (step + 1) / self.rate) > 0.5 / self.rate:  # the engine resets after a divergence
                break
            mujoco.mj_fwdPosition(model, data)  # after a step, `sensordata` holds the values of its beginning
            mujoco.mj_sensorPos(model, data)
            shown[step] = data.sensordata[list(self.sensors)]
        return shown


def find(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str, file: Path) -> int:
    """Return the index of a named object."""
    index = int(mujoco.mj_name2id(model, kind, name))
    if index < 0:
        raise ModelFileError(
            f"{file} has no '{name}' ({kind.name}); the delivered model must keep joints, actuators and sensors."
        )
    return index


def find_qpos_index(model: mujoco.MjModel, actuator: int) -> tuple[int, ...]:
    """Return the index in `qpos` of the joint that an actuator drives alone, which may be a goal beside the arm."""
    kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    if kind == int(mujoco.mjtTrn.mjTRN_JOINT):
        return (int(model.jnt_qposadr[target]),)
    if kind == int(mujoco.mjtTrn.mjTRN_TENDON) and model.tendon_num[target] == 1:
        return (int(model.jnt_qposadr[model.wrap_objid[model.tendon_adr[target]]]),)
    return ()


def find_actuators(file: Path, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the actuators of a nominal model's joints.

    Raises:
        JointMismatch: a joint has no named actuator.
    """
    spec = mujoco.MjSpec.from_file(str(file))
    names = {actuator.target: actuator.name for actuator in spec.actuators}
    if missing := [joint for joint in joints if not names.get(joint)]:
        raise JointMismatch(f"{file} has no named actuator for the joint '{missing[0]}'.")
    return tuple(names[joint] for joint in joints)


# commands (E, T, n), first positions and speeds (E, 2n) → positions (E, T, n)
Predict = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class FreshErrors:
    """Prediction errors on the fresh episodes, RMSE [rad]."""

    floor: float  # of a perfect prediction
    after: float | None  # of the prediction; None if it diverged, or there is none


@dataclass(frozen=True, kw_only=True)
class ModelErrors(FreshErrors):
    """Errors of a delivered model, the nominal model and the oracle."""

    before: float | None  # of the nominal model; None if it diverged
    # why the delivered model cannot be used; None if it can
    fault: str | None = field(default=None, metadata={"optional": True})
    least: float | None = None  # of a model with the true parameters; None where no model file can express them


@dataclass(frozen=True)
class Fresh:
    """Episodes that are kept back from the workflow."""

    joints: tuple[str, ...]  # names of the measured joints
    rate: float  # control rate [Hz]
    commands: np.ndarray  # [rad, N m], shape (E, T, n)
    positions: np.ndarray  # True positions [rad], shape (E, T + 1, n)
    readings: np.ndarray  # measured positions [rad], shape (E, T + 1, n)
    starts: np.ndarray  # initial states of a prediction, positions [rad] then speeds [rad/s], shape (E, 2n)

    @classmethod
    def load(cls, folder: Path, joints: tuple[str, ...]) -> "Fresh":
        """Read the fresh episodes from a case's folder."""
        with np.load(folder / FRESH) as stored:
            readings = stored["readings"]
            still = np.concatenate([readings[:, 0], np.zeros_like(readings[:, 0])], axis=1)
            starts = stored.get("starts", still)
            return cls(joints, float(stored["rate"]), stored["commands"], stored["positions"], readings, starts)

    @property
    def floor(self) -> float:
        """RMSE of a perfect prediction, from noise and rounding alone [rad]."""
        return float(np.sqrt(np.square(self.readings - self.positions)[:, 1:].mean()))

    def error(self, predict: Predict) -> float | None:
        """Return a prediction's RMSE over all joints and steps [rad]; None if it diverged."""
        predicted = predict(self.commands, self.starts)
        error = float(np.sqrt(np.square(predicted - self.readings[:, 1:]).mean()))
        return error if np.isfinite(error) else None

    def errors_of_models(self, folder: Path, delivered: Path, least: float | None = None) -> ModelErrors:
        """Return the errors of the nominal and the delivered model; `least` is the oracle's."""
        servos, after, fault = find_actuators(folder / NOMINAL, self.joints), None, None
        before = self.error(self._load_model(folder / NOMINAL, servos).play)
        try:
            after = self.error(self._load_model(delivered, servos).play)
        except NasError as error:  # an unusable model is a result of the benchmark, not an error
            fault = str(error)
        return ModelErrors(floor=self.floor, before=before, after=after, fault=fault, least=least)

    def error_of(self, model: mujoco.MjModel, nominal: Path) -> float | None:
        """Return the RMSE [rad] of a compiled model whose actuators are named as in the file `nominal`."""
        servos = find_actuators(nominal, self.joints)
        return self.error(Delivered.of(model, self.joints, servos, self.rate, nominal).play)

    def _load_model(self, file: Path, servos: tuple[str, ...]) -> Delivered:
        return Delivered.load(file, self.joints, servos, self.rate)


WINDOW = 0.05  # [s] window over which speeds are computed
LEAN = 0.5  # [rad] control error at which a servo without limits gives a large torque
FINE = 0.0005  # [s] physics step whose discretisation error is below the noise


def compute_oracle_error(folder: Path, answer: SealedAnswer, fresh: Fresh) -> float | None:
    """Return the RMSE [rad] on the fresh episodes of a model with the true effects and base parameters.

    Fresh episodes start at the first measured pose, whatever was commanded before. So even the true model errs until
    the state of a play, a dead band or a delay no longer depends on it: no workflow can do better.

    Returns:
        None if an effect is outside the catalogue, no model file can express it, or the model diverged.
    """
    try:
        effects = [make_effect(entry.effect, entry.joint, entry.parameters) for entry in answer.effects]
    except UnknownName:
        return None
    spec = mujoco.MjSpec.from_file(str(folder / NOMINAL))
    spec.option.timestep = min(spec.option.timestep, FINE)
    multiply(spec, fresh.joints, answer.base)
    forms = [effect.written_form(measure_scales(spec, effect, fresh)) for effect in effects]
    try:
        add_effects(spec, [form for form in forms if form is not None])
    except ModelFileError:
        return None
    for joint in fresh.joints:
        ensure_measured_tendon(spec, joint)
    return None if None in forms else fresh.error_of(spec.compile(), folder / NOMINAL)


def measure_scales(spec: mujoco.MjSpec, effect: Effect, fresh: Fresh) -> Scales:
    """Return large torque and speed at an effect's joint (the first joint for effects of the whole arm).

    In a model file, a load friction is designed for one torque and speed.
    """
    joint = fresh.joints[0] if effect.joint is None else effect.joint
    gap = max(1, round(WINDOW * fresh.rate))
    moved = np.abs(fresh.positions[:, gap:] - fresh.positions[:, :-gap])[..., fresh.joints.index(joint)]
    speed = float(np.percentile(moved, 98)) * fresh.rate / gap
    limits = read_force_range(find_joint_actuator(spec, joint))
    torque = max(map(abs, limits)) if limits else read_servo_stiffness(spec, joint) * LEAN
    return Scales(read_servo_stiffness(spec, joint), 0.0, 0.0, 0.0, torque, speed)
