"""Friction under load as a model file has it moves a servo as its equation does, without anything between the steps."""

import math

import mujoco
import numpy as np
import pytest
from support.effect_samples import PERIOD, SIGNALS, Lever, effect, rms_degrees, simulate

from nas_data.effects.base import Effect, add_effects, make_effect
from nas_data.effects.load_friction import PressedFriction
from nas_data.errors import ModelFileError
from nas_data.mjcf.actuator_lookup import find_driven_joint
from nas_data.robots.base import find_robot
from nas_data.simulators.lock_joints import lock_unmeasured_joints
from nas_data.simulators.mujoco import MujocoSimulator

STEP = 0.0005  # [s] physics step of written model files
TORQUE, SPEED = 0.2, 4.0  # what is large in an XL-320
QUICK = Lever(inertia=0.0004, damping=0.005, friction=0.005)  # four times as quick as one


def pressed(ratio: float, joint: str = "j", torque: float = TORQUE, speed: float = SPEED) -> Effect:
    return PressedFriction(joint=joint, ratio=ratio, torque=torque, speed=speed)


def edited(lever: Lever, *effects: Effect) -> mujoco.MjSpec:
    spec = lever.spec(STEP)
    add_effects(spec, effects)
    return spec


def played(spec: mujoco.MjSpec, commands: np.ndarray, load: float = 0.0) -> np.ndarray:
    """Play commands in plain MuJoCo, from the text of the file; return the angle after each [rad]."""
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    data = mujoco.MjData(model)
    data.qfrc_applied[model.joint("j").dofadr[0]] = load
    angles = []
    for command in commands:
        data.ctrl[0] = command
        mujoco.mj_step(model, data, round(PERIOD / STEP))
        angles.append(data.joint("j").qpos[0])
    return np.array(angles)


@pytest.mark.parametrize("signal", ["triangle", "sine", "holds"])
@pytest.mark.parametrize("ratio", [0.02, 0.1, 0.3, 0.6])
def test_a_pad_rubs_as_the_equation_says(ratio, signal):
    expected = Lever().move(SIGNALS[signal], friction=lambda speed, torque: ratio * abs(torque))
    assert rms_degrees(played(edited(Lever(), pressed(ratio)), SIGNALS[signal]) - expected) < 0.12
    if ratio >= 0.1:
        assert rms_degrees(Lever().move(SIGNALS[signal]) - expected) > 0.5


def test_a_quick_joint_has_stops_that_do_not_jam():
    """Made for the speed that is usual there; one made for slow motion would brake."""
    expected = QUICK.move(SIGNALS["holds"], friction=lambda speed, torque: 0.3 * abs(torque))
    assert np.abs(np.diff(expected)).max() / PERIOD > 15
    assert rms_degrees(played(edited(QUICK, pressed(0.3, speed=15.0)), SIGNALS["holds"]) - expected) < 0.5
    assert rms_degrees(played(edited(QUICK, pressed(0.3, speed=1.0)), SIGNALS["holds"]) - expected) > 1.0


@pytest.mark.parametrize("load", [0.02, 0.1, 0.16])
def test_a_pressed_joint_holds_without_creep_or_chatter(load):
    """Against a load that then falls by less than the friction."""
    spec = edited(Lever(friction=0.0, damping=0.005), pressed(0.2))
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    data = mujoco.MjData(model)
    angles, speeds = [], []
    for step in range(500):
        data.qfrc_applied[model.joint("j").dofadr[0]] = -load * (1.0 if step < 300 else 0.95)
        mujoco.mj_step(model, data, round(PERIOD / STEP))
        angles.append(data.joint("j").qpos[0])
        speeds.append(data.joint("j").qvel[0])
    assert np.abs(np.array(angles[250:]) - angles[250]).max() < math.radians(0.02)
    assert np.abs(speeds[250:]).max() < 0.01
    assert angles[250] < -0.8 * load / 0.336 / 1.2


BESIDE = {
    "deadband": {"half_width": 0.03},
    "torque_limit": {"torque": 0.08},
    "speed_limit": {"speed": 1.5},
    "command_delay": {"delay": 0.03},
    "servo_stiffness": {"factor": 0.6},
    "coulomb_friction": {"torque": 0.02},
    "stribeck_friction": {"torque": 0.03, "kinetic_ratio": 0.5, "stribeck_velocity": 0.3},
    "viscous_friction": {"coefficient": 0.02},
}


@pytest.mark.parametrize("name", BESIDE)
def test_a_pad_feels_a_servo_as_other_effects_leave_it(name, tmp_path):
    """Delay, limits, dead band: the file does with a pad what the simulator does with its hook."""
    other = effect(name, **BESIDE[name])
    hooked = simulate(tmp_path, Lever(), SIGNALS["holds"], other, effect("load_friction", ratio=0.3))
    plain = simulate(tmp_path, Lever(), SIGNALS["holds"], other)
    found = played(edited(Lever(), pressed(0.3), other), SIGNALS["holds"])
    assert rms_degrees(plain - hooked) > 1.0
    assert rms_degrees(found - hooked) < 0.4


def arm(*effects: Effect, change=lambda spec: None) -> mujoco.MjSpec:
    spec = find_robot("ergojr").spec()
    spec.option.timestep = STEP
    change(spec)
    add_effects(spec, effects)
    return spec


JOINTS = ("m1", "m2", "m3", "m4", "m5", "m6")
RATIOS = {"m2": 0.3, "m3": 0.15, "m5": 0.2}


def rolled(file: mujoco.MjSpec, tmp_path, *effects: Effect) -> np.ndarray:
    path = tmp_path / "arm.xml"
    path.write_text(file.to_xml())
    commands = np.repeat(np.random.default_rng(0).uniform(-0.9, 0.9, (2, 5, 6)), 50, axis=1)
    simulator = MujocoSimulator.load(path, PERIOD, JOINTS, effects, threads=1)
    return simulator.rollout(np.zeros((2, 12)), commands)[..., :6]


@pytest.mark.parametrize("contacts", [True, False])
def test_pads_in_an_arm_s_file_do_what_the_simulator_does(contacts, tmp_path):
    """Whatever frames and gravity do, and though the model switched contacts off."""

    def switch_off(spec: mujoco.MjSpec) -> None:
        if not contacts:
            spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
            for geom in spec.geoms:
                geom.contype = geom.conaffinity = 1  # would collide everywhere

    hooked = [make_effect("load_friction", joint, {"ratio": ratio}) for joint, ratio in RATIOS.items()]
    expected = rolled(arm(change=switch_off), tmp_path, *hooked)
    plain = rolled(arm(change=switch_off), tmp_path)
    found = rolled(arm(*(pressed(r, joint) for joint, r in RATIOS.items()), change=switch_off), tmp_path)
    assert rms_degrees(plain - expected) > 2.0
    assert rms_degrees(found - expected) < 0.1


def test_a_model_with_pads_is_an_arm_like_any_other():
    """Its servos drive the same joints in the same order, and nothing of the pad counts as a joint of the arm."""
    spec = arm(*(pressed(0.3, joint) for joint in JOINTS), make_effect("joint_offset", "m3", {"offset": 0.03}))
    assert [find_driven_joint(spec, actuator) for actuator in spec.actuators] == list(JOINTS)
    assert lock_unmeasured_joints(spec, JOINTS) == ()


def test_a_pad_is_refused_where_it_would_rub_something_else():
    """Beside play the body turns by servo and play, and the servo's friction acts on the servo alone."""
    with pytest.raises(ModelFileError, match="the only joint of its body"):
        arm(make_effect("backlash", "m2", {"half_width": 0.02}), pressed(0.3, "m2"))
    with pytest.raises(ModelFileError, match="already"):
        arm(pressed(0.3, "m2"), pressed(0.3, "m2"))


def test_a_servo_that_inherits_its_joints_range_keeps_it_when_a_pad_drives_it():
    """The tendon that the servo then pulls has no range, and the file would not compile."""
    spec = Lever().spec(STEP)
    spec.joint("j").range, spec.joint("j").limited = (-1.0, 1.5), mujoco.mjtLimited.mjLIMITED_TRUE
    spec.actuators[0].inheritrange = 0.5
    inherited = spec.copy().compile().actuator_ctrlrange[0]
    add_effects(spec, [pressed(0.1)])
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    assert model.actuator_ctrlrange[0] == pytest.approx(inherited)
    assert inherited == pytest.approx([-0.375, 0.875])
