"""Pairing: the source's prediction of every measured transition, in batched rollouts."""

from dataclasses import replace

import mujoco
import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    EFFORT,
    ENVIRONMENT,
    NEXT_STATE,
    POSITION,
    SIM_ENVIRONMENT,
    SIM_STATE,
    STATE,
    VELOCITY,
    make_action_feature,
    make_state_feature,
)
from nas_data.dataset.start_velocities import find_start_velocities
from nas_data.dataset.torque_off import find_torque_off, find_torque_on
from nas_data.errors import JointMismatch
from nas_data.joint_units import compute_angle_scales, find_joint_unit
from nas_data.log import warn, warn_once
from nas_data.robots.base import URDF, Robot
from nas_data.simulators.base import Simulator
from nas_data.simulators.contact import find_lasting_overlaps
from nas_data.simulators.lock_joints import refuse_ground_contact
from nas_data.simulators.mujoco import MujocoSimulator

ACTUATORS = {POSITION: "a <position>", VELOCITY: "a <velocity>", EFFORT: "a <motor>"}
POSTURES = 100  # postures in which a robot's contacts with itself and with the ground are checked
PROBES = 500  # transitions with which a source is compared
SAME_SOURCE = 1e-5  # [rad] engines of other versions and machines differ by less
# At a slide, the next two are scaled by `joint_units.compute_angle_scales`.
SAME_PLACE = 0.01  # [rad] two readings of one position differ by less
MARGIN = 0.05  # [rad] by which calibrations of real arms and their models differ
FACTOR = 2.0  # half ranges from the middle beyond which a wrong unit is more likely than a wrong zero or a soft stop


def pair(dataset: Dataset, simulator: Simulator) -> Dataset:
    """Add `next.observation.sim_state` to a dataset of transitions, and `next.observation.sim_environment_state`.

    The source is reset to each measured state with its warm start zeroed, the command is held for one control period,
    and the joints are read. The result is bit-identical to a plain loop over `mj_step`. Where no servo of the recording
    has torque, MuJoCo's have none, either. Objects of both dataset and source are reset and read with the joints; φ
    corrects the joints only.

    Args:
        dataset: Transitions with 2n-states (see `as_transitions`).
        simulator: Source with the dataset's joints and rate.

    Returns:
        The dataset with the predictions as float32, shape (N, 2n), and (N, m) of the objects.

    Raises:
        JointMismatch: joints, rate or command type differ.
    """
    check_fits(dataset, simulator)
    dataset = with_model_units(dataset, simulator)
    predicted = predict_transitions(dataset, simulator).astype(np.float32)
    width = dataset.states.shape[1]
    paired = dataset.with_column(SIM_STATE, make_state_feature(dataset.joints, simulator.slides), predicted[:, :width])
    if predicted.shape[1] == width:
        return paired
    return paired.with_column(SIM_ENVIRONMENT, simulator.object_feature, predicted[:, width:])


def predict_transitions(dataset: Dataset, simulator: Simulator, rows: slice = slice(None)) -> np.ndarray:
    """Return a source's next states of some rows, shape (rows, 2n or 2n + m); see `pair`."""
    states, commands = read_scene_states(dataset, simulator, rows), dataset.commands[rows]
    predicted = simulator.predict(states, commands, find_continuing_frames(dataset)[rows])
    off = find_torque_off(dataset)[rows]
    if off.any() and isinstance(simulator, MujocoSimulator):
        never = np.zeros(int(off.sum()), int)
        predicted[off] = simulator.rollout(states[off], commands[off][:, None], torque_off_from=never)[:, 0]
    return predicted


def with_model_units(dataset: Dataset, simulator: Simulator) -> Dataset:
    """Return the dataset with the model's units of hinges and slides; no value changes.

    A recording imported without a model names no units, or calls a slide's metres radians.

    Args:
        dataset: Transitions with 2n-states of a simulator's joints.
        simulator: The model.

    Raises:
        JointMismatch: a joint in metres is a hinge in the model.
    """
    turned = [joint for joint in simulator.joints if joint in dataset.slides and joint not in simulator.slides]
    if turned:
        raise JointMismatch(
            f"The dataset has {turned[0]} in metres, but the model's {turned[0]} is a hinge, in radians; "
            "give the model of this robot, or correct 'unit' in the map and import again."
        )
    wrong = [joint for joint in simulator.slides if joint not in dataset.slides]
    if not wrong:
        return dataset
    if any(dataset.features[STATE].units):
        warn_once(
            f"{', '.join(wrong)} has angles in the dataset but is a slide in the model: its values are treated "
            "as metres and newtons"
        )
    state = make_state_feature(dataset.joints, simulator.slides)
    command = make_action_feature(dataset.joints, simulator.kinds, simulator.slides)
    known = {STATE: state, ACTION: command, NEXT_STATE: state, SIM_STATE: state}
    features = {
        key: replace(feature, dtype=dataset.features[key].dtype)
        for key, feature in known.items()
        if key in dataset.features
    }
    return replace(dataset, features={**dataset.features, **features})


def find_continuing_frames(dataset: Dataset) -> np.ndarray:
    """Return a mask of the frames that begin where the previous one ended, shape (N,): they continue its motion."""
    n, result = len(dataset.joints), np.zeros(dataset.n_frames, bool)
    ends, begins = dataset.next_states[:-1, :n], dataset.states[1:, :n]
    travel = np.ptp(dataset.states[:, :n], axis=0) if dataset.n_frames else np.zeros(n)
    near = SAME_PLACE * compute_angle_scales(dataset.joints, dataset.slides, travel)
    result[1:] = (np.abs(begins - ends) <= near).all(axis=1)
    result[dataset.starts[dataset.lengths > 0]] = False
    return result


def read_scene_states(dataset: Dataset, simulator: Simulator, rows: slice | np.ndarray = slice(None)) -> np.ndarray:
    """Return measured states for a simulator: joints, then its objects if the dataset has all of them.

    Args:
        dataset: Transitions with 2n-states.
        simulator: Its objects are looked up by name.
        rows: Frames to return.

    Returns:
        States, shape (rows, 2n), or (rows, 2n + m) with the objects.
    """
    states, objects = dataset.states[rows], read_object_states(dataset, simulator)
    return np.concatenate([states, objects[rows]], axis=1) if objects.shape[1] else states


def read_initial_states(dataset: Dataset, simulator: Simulator | None) -> np.ndarray:
    """Return the initial states of open-loop rollouts: measured positions, and the episodes' start velocities.

    Args:
        dataset: Transitions with 2n-states.
        simulator: Its objects are looked up by name; None for no objects.

    Returns:
        States, shape (E, 2n), or (E, 2n + m) with the simulator's objects, float64.
    """
    n = len(dataset.joints)
    states = dataset.states if simulator is None else read_scene_states(dataset, simulator)
    first = states[dataset.starts].astype(float)
    first[:, n : 2 * n] = find_start_velocities(dataset).values
    return first


def read_object_states(dataset: Dataset, simulator: Simulator) -> np.ndarray:
    """Return the measured states of a simulator's objects, shape (N, m); (N, 0) if the dataset lacks any."""
    wanted = simulator.object_feature.names
    held = dataset.features[ENVIRONMENT].names if ENVIRONMENT in dataset.features else ()
    if not wanted or not set(wanted) <= set(held):
        return np.empty((dataset.n_frames, 0), np.float32)
    column = dataset.columns[ENVIRONMENT]
    return column if wanted == held else column[:, [held.index(name) for name in wanted]]


def describe_missing_objects(dataset: Dataset, simulator: Simulator) -> list[str]:
    """Warn of source objects that stay in their reference posture because the dataset lacks them."""
    held = dataset.features[ENVIRONMENT].names if ENVIRONMENT in dataset.features else ()
    missing = [name for name in simulator.object_feature.names if name not in held]
    if not missing or not held:
        return []
    return [f"'{ENVIRONMENT}' lacks {missing[0]}, so that the source's objects start in their reference posture"]


def check_source(dataset: Dataset, simulator: Simulator) -> None:
    """Check that a source predicts what a paired dataset holds where the torque is on.

    Raises:
        JointMismatch: it is another source, or has another robot, rate or command type.
    """
    check_fits(dataset, simulator)
    n, rows = len(dataset.joints), slice(0, PROBES)
    on = find_torque_on(dataset)[rows]
    if not on.any():
        return
    predicted = predict_transitions(dataset, simulator, rows)
    each = np.abs(predicted[:, :n] - dataset.sim_states[rows, :n])[on].mean(axis=0)
    joint = dataset.joints[int(each.argmax())]
    if not each.mean() < SAME_SOURCE:
        raise JointMismatch(
            f"The source predicts other states than those in the dataset, those of {joint} by "
            f"{each.max():.2g} {find_joint_unit(joint, dataset.slides).si} in one step: "
            "the dataset was paired with another one; pair it again with 'nas pair --model'."
        )


def warn_of_ranges(dataset: Dataset, robot: Robot) -> list[str]:
    """Warn of joints whose measured positions leave the model's range: the model may be wrong.

    Args:
        dataset: Transitions with 2n-states, n joints that the model has.
        robot: The source, without its effects.

    Returns:
        The warnings.
    """
    found, model = [], robot.spec().compile()
    for place, joint in enumerate(dataset.joints):
        hinge = int(model.joint(joint).type[0]) == int(mujoco.mjtJoint.mjJNT_HINGE)
        low, high = model.joint(joint).range
        if not len(dataset.states) or not model.jnt_limited[model.joint(joint).id]:
            continue
        margin = MARGIN * float(compute_angle_scales([joint], () if hinge else [joint], np.array([high - low]))[0])
        positions = dataset.states[:, place]
        furthest = float(positions[np.argmax(np.maximum(positions - high, low - positions))])
        if not low - margin <= furthest <= high + margin:
            unit = "rad" if hinge else "m"
            if abs(furthest - (low + high) / 2) <= FACTOR * (high - low) / 2:
                doubt = "does the arm move further than its model, or have another zero?"
            elif not hinge:
                doubt = "is the model in metres?"
            elif robot.mjcf.suffix == URDF:
                doubt = "are its limits in radians, as a URDF has them?"
            else:
                doubt = "is the model in the unit that its compiler's angle= gives?"
            found.append(
                f"measured positions of {joint} reach {furthest:.3g} {unit}, outside the model's range "
                f"{low:.3g} to {high:.3g} {unit}; {doubt}"
            )
    warn(found)
    return found


def warn_of_overlaps(dataset: Dataset, simulator: Simulator) -> list[str]:
    """Warn of bodies of the source whose shapes overlap in nearly all measured postures, and push each other away.

    Args:
        dataset: Transitions with 2n-states.
        simulator: The source; PyBullet's has no meshes and is not looked at.

    Returns:
        What was said, a sentence each.
    """
    if not isinstance(simulator, MujocoSimulator) or not dataset.n_frames:
        return []
    path, found = simulator.robot.mjcf, []
    postures = dataset.states[_choose_postures(dataset), : len(dataset.joints)]
    for pair, distance in find_lasting_overlaps(simulator, postures).items():
        bodies = [simulator.model.body(index) for index in pair]
        one, other = (describe_body(simulator.model, index) for index in pair)
        remedy = (
            "take the <collision> of one of them out of the model"
            if path.suffix == URDF
            else '{}write <contact><exclude body1="{}" body2="{}"/></contact>'.format(
                "" if all(body.name for body in bodies) else "name both bodies and ",
                *(body.name or "…" for body in bodies),
            )
        )
        found.append(
            f"{one} and {other} of {path} overlap in nearly all measured postures, by up to {-1e3 * distance:.2g} "
            f"mm, so that their contact pushes the joints: {remedy} if the robot's parts do not touch there"
        )
    warn(found)
    return found


def describe_body(model: mujoco.MjModel, body: int) -> str:
    """Return the quoted name of a body; without a name, in words, by its joint or its parent."""
    own = model.body(body)
    if own.name:
        return f"'{own.name}'"
    if int(own.jntnum[0]):
        return f"the body of joint '{model.joint(int(own.jntadr[0])).name}'"
    return f"a body without a name in {describe_body(model, int(own.parentid[0]))}"


def _choose_postures(dataset: Dataset) -> np.ndarray:
    """Return the indices of frames spread over a dataset, `POSTURES` at most."""
    return np.unique(np.linspace(0, dataset.n_frames - 1, min(dataset.n_frames, POSTURES)).astype(int))


def check_fits(dataset: Dataset, simulator: Simulator) -> None:
    """Check robot, rate and command type of a simulator.

    Raises:
        JointMismatch: one differs; the message has both values.
    """
    if simulator.joints != dataset.joints:
        raise JointMismatch(
            f"The simulator has the joints {', '.join(simulator.joints)}; the dataset {', '.join(dataset.joints)}."
        )
    if isinstance(simulator, MujocoSimulator) and simulator.robot.bases:
        postures = dataset.states[_choose_postures(dataset), : len(dataset.joints)]
        refuse_ground_contact(simulator.model, simulator.layout, postures, str(simulator.robot.mjcf))
    if abs(simulator.period * dataset.fps - 1) > 1e-6:
        raise JointMismatch(f"The simulator steps at {1 / simulator.period:g} Hz, the dataset at {dataset.fps:g} Hz.")
    names = {POSITION: "positions", VELOCITY: "velocities", EFFORT: "torques"}
    for joint, given, taken in zip(dataset.joints, dataset.kinds, simulator.kinds, strict=True):
        if given != taken:
            raise JointMismatch(
                f"The dataset commands {names[given]} of {joint}, the model's actuator takes {names[taken]}; "
                f"{_suggest_actuator(simulator, given)}."
            )


def _suggest_actuator(simulator: Simulator, kind: str) -> str:
    """Suggest how to give a model actuators for another command type."""
    robot = getattr(simulator, "robot", None)
    if isinstance(robot, Robot) and robot.mjcf.suffix == URDF and kind != VELOCITY:
        return f"a URDF does not define its actuators: give --actuators {'torque' if kind == EFFORT else 'position'}"
    return f"give a model with {ACTUATORS[kind]} there"
