"""The audits of recordings: silent on exact data at any rate, and each speaks on its fault."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from nas_data.dataset.audits import audit, audit_dataset
from nas_data.dataset.audits.base import Expected
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import (
    ACTION,
    EFFORT,
    NEXT_STATE,
    POSITION,
    STATE,
    TIME,
    VELOCITY,
    Feature,
    make_action_feature,
    make_position_feature,
    make_state_feature,
    make_time_feature,
)
from nas_data.dataset.provenance import Provenance
from nas_data.dataset.recording import extract_recordings
from nas_data.dataset.transitions import estimate_velocities
from nas_data.dataset.verify import examine
from nas_data.dataset.write import write

RATES = (20, 30, 50, 100, 200, 500, 1000)  # [Hz]
JOINTS = ("j1", "j2")
QUANTUM = 2 * np.pi / 4096  # [rad]
ARM = """<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast"/><worldbody>
<body pos="0 0 0.5"><joint name="j1" axis="0 1 0" damping="0.05" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.01" mass="0.05" contype="0" conaffinity="0"/>
<body pos="0.15 0 0"><joint name="j2" axis="0 1 0" damping="0.05" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.03" contype="0" conaffinity="0"/>
</body></body></worldbody>
<actuator><position joint="j1" kp="20" kv="0.3"/><position joint="j2" kp="20" kv="0.3"/></actuator></mujoco>"""


def commands_of(signal: str, rate: int, seconds: float) -> np.ndarray:
    """Targets of two joints [rad]: jumps that a servo follows within two rows at 20 Hz, or slow sines."""
    time = np.arange(int(seconds * rate)) / rate
    if signal == "sines":
        return np.sin(2 * np.pi * time[:, None] * [0.4, 0.65] + [0.3, 1.2])
    held = np.random.default_rng(3).uniform(-0.7, 0.7, (int(seconds / 0.4) + 1, 2))
    return held[(time / 0.4).astype(int)]


@cache
def exact(rate: int, signal: str = "steps", episodes: int = 2, seconds: float = 6.0) -> Dataset:
    """What the simulator itself did, positions and velocities to the last bit of what is stored."""
    model = mujoco.MjModel.from_xml_string(ARM)
    commands = commands_of(signal, rate, seconds)
    data, states = mujoco.MjData(model), []
    for command in commands:
        states.append(np.concatenate([data.qpos, data.qvel]))
        data.ctrl[:] = command
        mujoco.mj_step(model, data, 1000 // rate)
    states.append(np.concatenate([data.qpos, data.qvel]))
    return dataset_of(np.array(states), commands, rate, episodes)


def dataset_of(states: np.ndarray, commands: np.ndarray, rate: int, episodes: int = 2) -> Dataset:
    """Transitions of N + 1 states (N + 1, 4) and N commands, the same in every episode."""
    time = np.arange(len(commands))[:, None] / rate
    columns = {STATE: states[:-1], ACTION: commands, NEXT_STATE: states[1:], TIME: time}
    features = {
        STATE: make_state_feature(JOINTS),
        ACTION: make_position_feature(JOINTS),
        NEXT_STATE: make_state_feature(JOINTS),
        TIME: make_time_feature(),
    }
    tiled = {key: np.tile(column, (episodes, 1)).astype(features[key].dtype) for key, column in columns.items()}
    return Dataset(features, tiled, np.full(episodes, len(commands)), float(rate), "arm")


def as_slides(dataset: Dataset, metres: float = 0.02) -> Dataset:
    """The same motion by slides that go so many metres where the hinges turn by a radian."""
    state = make_state_feature(JOINTS, JOINTS)
    units = {STATE: state, NEXT_STATE: state, ACTION: make_action_feature(JOINTS, (POSITION, POSITION), JOINTS)}
    columns = {key: metres * dataset.columns[key].astype(float) for key in units}
    return replace(dataset, features={**dataset.features, **units}, columns={**dataset.columns, **columns})


def as_mixed(dataset: Dataset, kind: str) -> Dataset:
    """The same motion where the first joint's servo turns velocities or torques into its motion, not positions."""
    first = dataset.next_states[:, 2] if kind == VELOCITY else 0.3 * np.cos(np.arange(dataset.n_frames) / dataset.fps)
    return replace(
        dataset,
        features=dataset.features | {ACTION: make_action_feature(JOINTS, (kind, POSITION))},
        columns=dataset.columns | {ACTION: np.column_stack([first, dataset.commands[:, 1]])},
    )


def heard(dataset: Dataset) -> set[str]:
    return {finding.check for finding in audit_dataset(dataset)}


@pytest.mark.parametrize("signal", ["steps", "sines"])
@pytest.mark.parametrize("rate", RATES)
def test_exact_data_are_passed_in_silence(rate, signal):
    assert audit_dataset(exact(rate, signal)) == ()


@pytest.mark.parametrize("signal", ["steps", "sines"])
@pytest.mark.parametrize("rate", RATES)
def test_an_encoder_and_derived_velocities_are_passed_in_silence(rate, signal):
    whole = exact(rate, signal, episodes=1)
    states = np.concatenate([whole.states, whole.next_states[-1:]]).astype(float)
    positions = np.round(states[:, :2] / QUANTUM) * QUANTUM
    rounded = dataset_of(np.hstack([positions, states[:, 2:]]), whole.commands, rate)
    assert audit_dataset(rounded) == ()
    derived = np.hstack([positions, estimate_velocities(positions, rate)])
    assert audit_dataset(dataset_of(derived, whole.commands, rate)) == ()


def edited(dataset: Dataset, **changes: Callable[[np.ndarray], np.ndarray]) -> Dataset:
    """The dataset with some columns changed: time, positions, velocities, commands."""
    columns = {key: column.astype(float) for key, column in dataset.columns.items()}
    for key in (STATE, NEXT_STATE):
        for name, part in (("positions", slice(0, 2)), ("velocities", slice(2, 4))):
            if name in changes:
                columns[key][:, part] = changes[name](columns[key][:, part])
    for name, key in (("time", TIME), ("commands", ACTION)):
        if name in changes:
            columns[key] = changes[name](columns[key])
    return replace(dataset, columns=columns)


def from_row(row: int, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """Change the rows from one on."""
    return lambda values: np.concatenate([values[:row], change(values[row:])])


def held(every: int) -> Callable[[np.ndarray], np.ndarray]:
    """Repeat readings, so that one in `every` rows is fresh."""
    return lambda values: values[np.arange(len(values)) // every * every]


def frozen(values: np.ndarray) -> np.ndarray:
    """Stop the second joint's reading in the second half."""
    half = len(values) // 2
    return np.hstack(
        [values[:, :1], np.concatenate([values[:half, 1:], np.repeat(values[half : half + 1, 1:], half, 0)])]
    )


def late(values: np.ndarray) -> np.ndarray:
    """Delay the register by 40 ms or two rows."""
    rows = max(2, round(0.04 * len(values) / 6))
    return np.concatenate([np.repeat(values[:1], rows, 0), values[:-rows]])


def jitter(values: np.ndarray) -> np.ndarray:
    period = values[1, 0] - values[0, 0]
    return values + (np.arange(len(values)) % 3)[:, None] * 0.35 * period


FAULTS: dict[str, dict[str, Callable[[np.ndarray], np.ndarray]]] = {
    "time_backwards": {"time": from_row(40, lambda time: time - 1.0)},
    "repeated_time": {"time": lambda time: np.where(np.arange(len(time))[:, None] == 7, time[6], time)},
    "rate": {"time": lambda time: 2 * time},
    "time_gap": {"time": from_row(60, lambda time: time + 1.0)},
    "irregular_time": {"time": jitter},
    "not_finite": {"positions": from_row(40, lambda values: values * np.nan)},
    "jump": {"positions": from_row(50, lambda values: values - 2 * np.pi)},
    "unit_slip": {"positions": np.degrees, "velocities": np.degrees, "commands": np.degrees},
    "command_scale": {"commands": np.degrees},
    "command_sign": {"commands": np.negative},
    "joints_swapped": {"commands": lambda values: values[:, ::-1]},
    "repeated_samples": {"positions": held(3), "velocities": held(3)},
    "frozen_reading": {"positions": frozen, "velocities": lambda values: frozen(values) * [1, 0]},
    "position_contradicts_velocity": {"positions": frozen},
    "velocity_scale": {"velocities": np.degrees},
    "velocity_lag": {"velocities": late},
}


@pytest.mark.parametrize("rate", [20, 100, 1000])
@pytest.mark.parametrize("check", FAULTS)
def test_each_fault_is_heard_at_any_rate(check, rate):
    dataset = edited(exact(rate, "sines", episodes=1), **FAULTS[check])
    if check == "unit_slip":  # units that are stored are believed
        features = {key: replace(feature, units=()) for key, feature in dataset.features.items()}
        dataset = replace(dataset, features=features)
    assert check in heard(dataset)


@pytest.mark.parametrize("signal", ["steps", "sines"])
@pytest.mark.parametrize("rate", [20, 100, 1000])
def test_exact_slides_are_passed_in_silence(rate, signal):
    assert audit_dataset(as_slides(exact(rate, signal))) == ()


def millimetres(values: np.ndarray) -> np.ndarray:
    return 1000 * values


FAULTS_OF_SLIDES = FAULTS | {
    "jump": {"positions": from_row(50, lambda values: values - 0.12)},
    "unit_slip": {"positions": millimetres, "velocities": millimetres, "commands": millimetres},
    "command_scale": {"commands": millimetres},
    "velocity_scale": {"velocities": millimetres},
}


@pytest.mark.parametrize("rate", [20, 100, 1000])
@pytest.mark.parametrize("check", FAULTS_OF_SLIDES)
def test_each_fault_of_a_finger_that_goes_millimetres_is_heard(check, rate):
    dataset = edited(as_slides(exact(rate, "sines", episodes=1)), **FAULTS_OF_SLIDES[check])
    findings = audit(next(extract_recordings(dataset)), Expected(rate=float(rate), slides=dataset.slides))
    said = [finding.what for finding in findings if finding.check == check]
    assert said
    assert not any("rad/s" in what or " rad" in what for what in said)


@pytest.mark.parametrize("kind", [VELOCITY, EFFORT])
@pytest.mark.parametrize("signal", ["steps", "sines"])
@pytest.mark.parametrize("rate", [20, 100, 1000])
def test_exact_mixed_arms_are_passed_in_silence(rate, signal, kind):
    assert audit_dataset(as_mixed(exact(rate, signal), kind)) == ()


@pytest.mark.parametrize("kind", [VELOCITY, EFFORT])
@pytest.mark.parametrize("check", sorted({*FAULTS, "command_is_position"} - {"joints_swapped"}))
def test_each_fault_is_heard_beside_a_joint_without_a_position_servo(check, kind):
    dataset = exact(100, "sines", episodes=1)
    faults = FAULTS | {"command_is_position": {"commands": lambda _: dataset.states[:, :2]}}
    dataset = as_mixed(edited(dataset, **faults[check]), kind)
    if check == "unit_slip":
        features = {key: replace(feature, units=()) for key, feature in dataset.features.items()}
        dataset = replace(dataset, features=features)
    found = [finding for finding in audit_dataset(dataset) if finding.check == check]
    assert found
    if check.startswith("command"):
        assert all("j2" in finding.what and "j1" not in finding.what for finding in found)


WHEEL = """<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody>
<body pos="0 0 0.5"><joint name="j1" axis="0 1 0" damping="0.05" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.01" mass="0.05" contype="0" conaffinity="0"/></body>
<body pos="0 1 0.5"><joint name="j2" type="slide" axis="1 0 0" damping="0.5" armature="0.1"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.03" contype="0" conaffinity="0"/></body></worldbody>
<actuator><velocity joint="j1" kv="1"/><velocity joint="j2" kv="50"/></actuator></mujoco>"""


@cache
def exact_speeds(rate: int, signal: str) -> Dataset:
    """What a hinge and a slide do that are commanded velocities, to the last bit of what is stored."""
    model = mujoco.MjModel.from_xml_string(WHEEL)
    commands = np.ones((6 * rate, 2)) if signal == "constant" else commands_of(signal, rate, 6.0)
    commands = commands * [2.0, 0.05]
    data, states = mujoco.MjData(model), []
    for command in commands:
        states.append(np.concatenate([data.qpos, data.qvel]))
        data.ctrl[:] = command
        mujoco.mj_step(model, data, 1000 // rate)
    states.append(np.concatenate([data.qpos, data.qvel]))
    dataset, state = dataset_of(np.array(states), commands, rate, 1), make_state_feature(JOINTS, ("j2",))
    command = make_action_feature(JOINTS, (VELOCITY, VELOCITY), ("j2",))
    return replace(dataset, features=dataset.features | {STATE: state, NEXT_STATE: state, ACTION: command})


@pytest.mark.parametrize("signal", ["steps", "sines", "constant"])
@pytest.mark.parametrize("rate", RATES)
def test_exact_velocity_servos_are_passed_in_silence(rate, signal):
    assert audit_dataset(exact_speeds(rate, signal)) == ()


@pytest.mark.parametrize("signal", ["steps", "sines", "constant"])
@pytest.mark.parametrize("rate", [20, 50, 100, 1000])
@pytest.mark.parametrize(
    ("factors", "check", "error", "units"),
    [
        ((180 / np.pi, 1), "command_scale", True, "degrees and radians"),
        ((np.pi / 180, 1), "command_scale", True, "degrees and radians"),
        ((60 / (2 * np.pi), 1), "command_scale", False, "turns a minute and rad/s"),
        ((1, 1000), "command_scale", True, "millimetres and metres"),
        ((1, 0.001), "command_scale", True, "millimetres and metres"),
        ((1, 100), "command_scale", False, "centimetres and metres"),
        ((-1, 1), "command_sign", False, ""),
        ((1, -1), "command_sign", False, ""),
    ],
)
def test_commanded_velocities_in_another_unit_or_sign_are_heard(rate, signal, factors, check, error, units):
    dataset = exact_speeds(rate, signal)
    (found,) = audit_dataset(replace(dataset, columns=dataset.columns | {ACTION: dataset.commands * factors}))
    assert (found.check, found.error) == (check, error) and units in found.what
    assert ("j1" in found.what) is (factors[0] != 1)


def test_velocities_taken_for_commands_are_heard():
    dataset = exact_speeds(50, "sines")
    copied = replace(dataset, columns=dataset.columns | {ACTION: dataset.states[:, 2:]})
    (found,) = audit_dataset(copied)
    assert found.check == "command_is_position" and "equals the measured velocity" in found.what


def test_large_torques_are_no_angles_and_leave_no_limits():
    dataset = as_mixed(exact(100, "sines", episodes=1), EFFORT)
    dataset = replace(dataset, columns=dataset.columns | {ACTION: dataset.commands * [100, 1]})
    (recording,) = extract_recordings(dataset)
    kinds, limits = {"j1": EFFORT}, {"j1": (-2.0, 2.0), "j2": (-0.5, 0.5)}
    found = audit(recording, Expected(rate=100.0, kinds=kinds, limits=limits))
    assert {finding.check for finding in found} == {"command_beyond_limits", "position_beyond_limits"}
    assert all("j1" not in finding.what for finding in found)


@pytest.mark.parametrize("metres", [0.005, 0.5])
def test_what_a_register_says_in_silence_does_not_depend_on_a_slides_range(metres):
    dataset = edited(as_slides(exact(100, "sines", episodes=1), metres), velocities=np.zeros_like)
    (silent,) = [finding for finding in audit_dataset(dataset) if finding.check == "velocity_scale"]
    assert "m/s" in silent.what


def test_positions_taken_for_commands_are_heard():
    dataset = exact(50, "sines", episodes=1)
    assert "command_is_position" in heard(replace(dataset, columns=dataset.columns | {ACTION: dataset.states[:, :2]}))


def test_rows_without_torque_are_heard():
    dataset = exact(50)
    off = (np.arange(dataset.n_frames) % 50 > 10).astype(np.float32)[:, None]
    assert "torque_off" in heard(dataset.with_column("nas.torque_enable", Feature(("torque_enable",)), off))


def test_limits_are_heard_where_they_are_known():
    (first, *_) = extract_recordings(exact(50, "sines"))
    found = audit(first, Expected(rate=50.0, limits={"j1": (-0.5, 2.0)}))
    assert {finding.check for finding in found} == {"command_beyond_limits", "position_beyond_limits"}


@pytest.mark.parametrize("check", ["rate", "time_gap", "irregular_time", "velocity_scale", "jump"])
def test_verify_says_what_the_audits_say(check, tmp_path):
    dataset = edited(exact(50, "sines"), **FAULTS[check])
    findings = [finding for finding in audit_dataset(dataset) if finding.check == check]
    found = examine(write(dataset, tmp_path / "d", Provenance(how="simulated", contiguous=False)))
    said = found.problems if findings[0].error else found.notes
    assert any(findings[0].what in sentence for sentence in said), (said, findings)


@pytest.mark.parametrize("frames", [1, 2])
def test_an_episode_of_a_frame_or_two_beside_whole_ones_is_no_fault(frames):
    whole = exact(50)
    short = dataset_of(whole.states[: frames + 1], whole.commands[:frames], 50, episodes=1)
    assert heard(short) == set()
