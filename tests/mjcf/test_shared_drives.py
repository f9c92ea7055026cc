"""Servos that move a joint and its followers through a fixed tendon take the joint's commands."""

import mujoco
import numpy as np
import pytest
from support.simulator_samples import EACH_ENGINE
from support.typical_effects import OF_OBJECTS, ON_ANY_ARM, typical

from nas_data.effects.base import Effect
from nas_data.errors import JointMismatch, ModelFileError, NasError
from nas_data.gap.finding.conditions import compute_torques, read_torque_limits
from nas_data.robots.base import find_robot
from nas_data.simulators.engines import load_simulator
from nas_data.simulators.limits import command_limits

PERIOD, STEPS = 0.02, 10  # [s], physics steps
SERVO = '<general name="grip" {on} biastype="affine" gainprm="0.4" biasprm="0 -{kp} -{kv}" ctrlrange="0 255"/>'
SPLIT = 'tendon="split"'
LINEAR = '<joint joint1="right" joint2="left" polycoef="0 -1 0 0 0" solref="0.002 1" solimp="0.9999 0.9999 0.001"/>'
TENDON = '<fixed name="split"><joint joint="left" coef="0.5"/><joint joint="right" coef="-0.5"/></fixed>'
GRIP = SERVO.format(on=SPLIT, kp=100, kv=1)
GRIPPER = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/><joint axis="0 1 0" damping="0.02" armature="0.001"/></default>
<worldbody><body pos="0 0.05 0.5"><joint name="left" range="-1 1"/>
<geom type="capsule" fromto="0 0 0 0 0 0.1" size="0.01" mass="0.04"/></body>
<body pos="0 -0.05 0.5"><joint name="right" range="-1 1"/>
<geom type="capsule" fromto="0 0 0 0 0 0.1" size="0.01" mass="0.03"/></body></worldbody>
<tendon>{tendon}</tendon><equality>{equality}</equality><actuator>{actuator}</actuator></mujoco>"""


def write(folder, tendon=TENDON, equality=LINEAR, actuator=GRIP):
    path = folder / "gripper.xml"
    path.write_text(GRIPPER.format(tendon=tendon, equality=equality, actuator=actuator))
    return path


def play(path, controls: np.ndarray) -> np.ndarray:
    """Play controls (T,) in plain MuJoCo; return the position of 'left', shape (T,)."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, rows = mujoco.MjData(model), []
    for control in controls:
        data.ctrl[0] = control
        mujoco.mj_step(model, data, STEPS)
        rows.append(data.joint("left").qpos[0])
    return np.array(rows)


COMMANDS = np.repeat(np.random.default_rng(0).uniform(0.1, 0.9, 6), 10)


@pytest.mark.parametrize(
    ("tendon", "equality", "length"),
    [
        (TENDON, LINEAR, 1.0),
        (TENDON, LINEAR.replace('joint1="right" joint2="left"', 'joint1="left" joint2="right"'), 1.0),
        (TENDON.replace('"-0.5"', '"-1.5"'), LINEAR.replace("0 -1 0", "0 -0.5 0"), 1.25),
        (TENDON.replace('<joint joint="right" coef="-0.5"/>', ""), LINEAR, 0.5),
        (TENDON.replace('"0.5"', '"-0.5"').replace('"-0.5"/></f', '"0.5"/></f'), LINEAR, -1.0),
    ],
    ids=["a gripper", "its equality the other way", "a follower at half speed", "one joint alone", "reversed"],
)
def test_a_servo_on_a_shared_drive_moves_exactly_as_on_its_tendon(tmp_path, tendon, equality, length):
    path = write(tmp_path, tendon, equality, SERVO.format(on=SPLIT, kp=100, kv=1).replace("0 255", "-400 400"))
    gripper = load_simulator(path, PERIOD, threads=1)
    assert (gripper.joints, gripper.kinds) == (("left",), (".pos",))
    moved = gripper.rollout(np.zeros((1, 2)), COMMANDS[None, :, None])[0, :, 0]
    # the servo's target length is control · 0.4 / 100
    assert np.abs(moved - play(path, COMMANDS * length * 100 / 0.4)).max() < 1e-12
    assert np.ptp(moved) > 0.3


def test_its_control_range_limits_the_commands_in_the_unit_of_the_joint(tmp_path):
    path = write(tmp_path, equality=LINEAR)
    low, high = command_limits(find_robot(path).spec().compile(), ("left",), str(path))
    assert (low[0], high[0]) == (0.0, 1.0)  # 255 · 0.4 / 100 is 1.02, and the joint's range ends at 1


@pytest.mark.parametrize("engine", EACH_ENGINE)
def test_both_engines_take_it(tmp_path, engine):
    if engine == "bullet":
        pytest.importorskip("pybullet")
    held = load_simulator(write(tmp_path), PERIOD, engine=engine).rollout(np.zeros((1, 2)), np.full((1, 100, 1), 0.5))
    assert held[0, -1, 0] == pytest.approx(0.5, abs=0.01)
    assert abs(held[0, -1, 1]) < 1e-3


def test_what_the_compiler_derives_from_the_tendon_stays(tmp_path):
    servo = '<position name="grip" tendon="split" kp="100" dampratio="1" inheritrange="1"/>'
    path = write(tmp_path, TENDON.replace('"split"', '"split" range="0 0.8"').replace('"-0.5"', '"-1"'), actuator=servo)
    model, edited = mujoco.MjModel.from_xml_path(str(path)), find_robot(path).spec().compile()
    assert edited.actuator_biasprm.tolist() == model.actuator_biasprm.tolist()
    assert edited.actuator_ctrlrange.tolist() == model.actuator_ctrlrange.tolist() == [[0.0, 0.8]]


def test_the_written_model_is_read_as_the_same_gripper(tmp_path):
    robot = find_robot(write(tmp_path))
    (tmp_path / "written.xml").write_text(robot.spec().to_xml())
    written = find_robot(tmp_path / "written.xml")
    assert written.joints == robot.joints == ("left",)
    assert written.edit is None
    assert written.spec().compile().ntendon == robot.spec().compile().ntendon == 2


def rigid(name: str) -> Effect:
    """Return an effect of the left finger; stops that yield feel the torque on that finger alone."""
    return typical(name, joint="left", **({"stiffness": np.inf} if name == "backlash" else {}))


@pytest.mark.parametrize(
    "equality", [LINEAR, LINEAR.replace('joint1="right" joint2="left"', 'joint1="left" joint2="right"')]
)
def test_of_two_coupled_fingers_one_takes_the_commands(tmp_path, equality):
    path, told = write(tmp_path, equality=equality), []
    for joints in (("left", "right"), ("right", "left")):
        with pytest.raises(JointMismatch, match=r"moves together with '\w+', whose commands drive both") as refusal:
            load_simulator(path, PERIOD, joints)
        told.append(str(refusal.value).partition("'")[2].partition("'")[0])
    assert told[0] == told[1]
    kept = "left" if told[0] == "right" else "right"
    assert load_simulator(path, PERIOD, (kept,)).joints == (kept,)


def test_a_motor_curve_of_a_shared_drive_is_refused(tmp_path):
    path = write(tmp_path, actuator=SERVO.format(on=SPLIT, kp=5, kv=0.2))
    with pytest.raises(ModelFileError, match="because its actuator acts through a tendon"):
        load_simulator(path, PERIOD, effects=(typical("motor_curve", joint="left"),), threads=1)


# friction under load counts the torque on the joint itself, which is half of the servo's; a motor curve is refused
@pytest.mark.parametrize("name", [n for n in ON_ANY_ARM if n not in {*OF_OBJECTS, "load_friction", "motor_curve"}])
def test_each_effect_acts_as_on_a_servo_of_the_joint(tmp_path, name):
    rows = []
    for on in (SPLIT, 'joint="left"'):
        path = write(tmp_path, actuator=SERVO.format(on=on, kp=5, kv=0.2).replace("0.4", "0.02"))
        gripper = load_simulator(path, PERIOD, effects=(rigid(name),), threads=1)
        rows.append(gripper.rollout(np.zeros((1, 2)), COMMANDS[None, :, None])[0, :, 0])
    # the constraint between the fingers gives way a little, and differently where the servo acts on one of them only
    assert np.abs(rows[0] - rows[1]).max() < 0.01


@pytest.mark.parametrize(
    ("tendon", "equality", "more"),
    [
        (TENDON, "", ""),
        (TENDON, LINEAR.replace("0 -1 0 0 0", "0 -1 0.3 0 0"), ""),
        (TENDON, LINEAR.replace("0 -1 0 0 0", "0.1 -1 0 0 0"), ""),
        (TENDON, LINEAR.replace("/>", ' active="false"/>'), ""),
        (TENDON.replace('"split"', '"split" actuatorfrcrange="-5 5"'), LINEAR, ""),
        (TENDON, LINEAR, '<motor tendon="split"/>'),
    ],
    ids=["no equality", "a curve", "an offset", "switched off", "a limited force", "a second actuator"],
)
def test_other_tendons_are_refused_and_the_remedy_works(tmp_path, tendon, equality, more):
    with pytest.raises(NasError, match=r"in place of 'grip' on the tendon 'split'.* write <position joint=…>"):
        find_robot(write(tmp_path, tendon, equality, GRIP + more))
    direct = '<position name="grip" joint="left" kp="100" kv="1"/>'
    assert find_robot(write(tmp_path, tendon, equality, direct)).joints == ("left",)


def test_a_joint_with_a_servo_of_its_own_keeps_it(tmp_path):
    robot = find_robot(write(tmp_path, actuator=f'<position joint="right" kp="9"/>{GRIP}'))
    assert (robot.joints, robot.edit) == (("right",), None)


def test_the_torque_on_the_joint_includes_that_on_its_followers(tmp_path):
    limited = GRIP.replace("ctrlrange", 'forcerange="-2 2" ctrlrange')
    gripper = load_simulator(write(tmp_path, actuator=limited), PERIOD, threads=1)
    _, torque = compute_torques(gripper, np.zeros((1, 2)), np.array([[0.9]]))
    assert torque[0, 0] == pytest.approx(2.0) == read_torque_limits(gripper)[1][0]
