"""What crosses the engine's border: commands in a joint's units, whatever the actuator's control is."""

from dataclasses import replace

import numpy as np
import pytest
from support.model_features import HINGE, PERIOD, SERVO, Way, commands_of, general

from nas_data.commands.record_sim import RecordSim
from nas_data.dataset.read import read
from nas_data.effects.base import add_effects, parse
from nas_data.errors import JointMismatch, ModelFileError, OptionError
from nas_data.pairing import pair
from nas_data.simulators.controls import find_command
from nas_data.simulators.limits import command_limits, find_excitable_limits
from nas_data.simulators.mujoco import MujocoSimulator

PLAIN = Way("plain", "position", SERVO)
GEARED = replace(PLAIN, actuator='<position joint="{j}" kp="5" kv="0.075" gear="-2"/>')
SCALED = replace(PLAIN, actuator=general(0.2, 0, -20, -0.3))
SHIFTED = replace(PLAIN, actuator=general(0.2, -25, -20, -0.3, options='ctrlrange="0 255"'))
EFFECTS = (
    "command_delay:joint=a,delay=0.03",
    "joint_offset:joint=a,offset=0.1",
    "deadband:joint=a,half_width=0.03",
    "speed_limit:joint=a,speed=1.0",
    "servo_stiffness:joint=a,factor=0.5",
    "servo_damping:joint=a,factor=0.5",
    "torque_limit:joint=a,torque=0.3",
    "backlash:joint=a,half_width=0.02",
    "load_friction:joint=a,ratio=0.2",
    "coulomb_friction:joint=a,torque=0.05",
)


@pytest.fixture
def load(tmp_path):
    def build(way, *effects):
        path = tmp_path / f"arm{abs(hash(way.text))}.xml"
        path.write_text(way.text)
        return MujocoSimulator.load(path, PERIOD, ("a", "b"), map(parse, effects), threads=1)

    return build


def played(simulator, way=PLAIN):
    commands, size = commands_of(way), 2 * len(simulator.joints)
    return simulator.rollout_settled(np.zeros((1, size)), commands[None])[0]


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("way", [GEARED, SCALED, SHIFTED], ids=["gear", "own unit", "own unit and zero"])
def test_effects_act_in_the_joint_s_units_whatever_the_control_is(load, way, effect):
    np.testing.assert_allclose(played(load(way, effect)), played(load(PLAIN, effect)), atol=2e-6)


@pytest.mark.parametrize("more", ["joint_offset:joint=a,offset=0.1", "servo_stiffness:joint=a,factor=0.5"])
@pytest.mark.parametrize("way", [GEARED, SCALED, SHIFTED], ids=["gear", "own unit", "own unit and zero"])
def test_a_speed_limit_stands_beside_others_in_any_order(load, way, more):
    limit = "speed_limit:joint=a,speed=1.0"
    for effects in ((limit, more), (more, limit)):
        np.testing.assert_allclose(played(load(way, *effects)), played(load(PLAIN, *effects)), atol=2e-6)


@pytest.mark.parametrize("more", ["servo_stiffness:joint=a,factor=0.5", "deadband:joint=a,half_width=0.03"])
@pytest.mark.parametrize("way", [SCALED, SHIFTED], ids=["own unit", "own unit and zero"])
def test_an_offset_keeps_its_size_when_the_servo_is_changed_after_it(load, way, more):
    effects = ("joint_offset:joint=a,offset=0.1", more)
    np.testing.assert_allclose(played(load(way, *effects)), played(load(PLAIN, *effects)), atol=2e-6)


@pytest.mark.parametrize("limit", [[], ["speed_limit:joint=a,speed=1.0"]], ids=["", "speed limit"])
@pytest.mark.parametrize("way", [GEARED, SCALED, SHIFTED], ids=["gear", "own unit", "own unit and zero"])
def test_a_written_model_takes_the_controls_of_the_model_that_was_handed_over(load, way, limit, tmp_path):
    """Its effects survive the file: what the file's controls ask for is read from it again."""
    effects = ["joint_offset:joint=a,offset=0.1", "backlash:joint=b,half_width=0.02", *limit]
    spec = load(way).robot.spec()
    add_effects(spec, map(parse, effects))
    spec.compile()
    (tmp_path / "written.xml").write_text(spec.to_xml())
    written = MujocoSimulator.load(tmp_path / "written.xml", PERIOD, ("a", "b"), threads=1)
    given, own = load(way), find_command(written.model, 0, "written")[1]
    assert own == find_command(given.model, 0, "given")[1]
    assert played(written)[:, 0] == pytest.approx(played(load(way, *effects))[:, 0], abs=1e-4)


def test_control_ranges_are_ranges_of_commands(load):
    reversed_ = load(replace(PLAIN, actuator='<position joint="{j}" kp="5" kv="0.1" gear="-2" ctrlrange="-1 2"/>'))
    low, high = command_limits(reversed_.model, reversed_.joints, "arm")
    assert (low.tolist(), high.tolist()) == ([-1.0, -1.0], [0.5, 0.5])
    gripper = load(SHIFTED)
    low, high = command_limits(gripper.model, gripper.joints, "arm")
    assert low == pytest.approx(-1.25) and high == pytest.approx(0.2 * 255 / 20 - 1.25)
    motor = load(replace(PLAIN, group="torque", actuator='<motor joint="{j}" gear="50" ctrlrange="-1 1"/>'))
    assert command_limits(motor.model, motor.joints, "arm")[1].tolist() == [50.0, 50.0]


def test_the_range_of_an_actuator_after_one_with_several_inputs_is_its_own(load):
    three = '<pid joint="{j}" kp="20" kv="0.3" input="pos vel ff" ctrlrange="-1 1" velrange="-2 2" ffrange="-3 3"/>'
    low, high = command_limits(load(replace(PLAIN, actuator=three)).model, ("a", "b"), "arm")
    assert (low.tolist(), high.tolist()) == ([-1.0, -1.0], [1.0, 1.0])


def test_a_speed_without_limits_is_not_made_up():
    with pytest.raises(OptionError, match=r"^The speed of b has no limits; give its actuator a ctrlrange, or play"):
        find_excitable_limits(np.array([-np.inf] * 2), np.array([np.inf] * 2), ("a", "b"), (".pos", ".vel"))


def test_closed_loops_take_commands(load):
    stepper, plain = load(SHIFTED).stepper(1), load(PLAIN).stepper(1)
    for command in commands_of(PLAIN)[:20]:
        np.testing.assert_allclose(stepper.step(command[None]), plain.step(command[None]), atol=1e-9)


def test_joints_that_a_dataset_lacks_are_held_by_servos_of_any_unit(load):
    """The arm rests at its reference, where a servo whose control has a zero of its own is not at a control of 0."""
    path = load(SHIFTED).robot.mjcf
    alone = MujocoSimulator.load(path, PERIOD, ("a",), threads=1)
    assert alone.layout.reference == pytest.approx([125.0, 125.0])


MIXED = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
<body pos="0 0 0.5"><joint name="servo" axis="0 1 0" range="-1 1" damping="0.05" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.05"/></body>
<body pos="0 0.2 0.5"><joint name="wheel" axis="0 1 0" armature="0.002"/>
<geom type="sphere" size="0.03" mass="0.05"/></body>
<body pos="0 0.4 0.5"><joint name="pendulum" axis="0 1 0" damping="0.02"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.01" mass="0.1"/></body></worldbody>
<actuator><position joint="servo" kp="20" kv="0.3" gear="2"/>
<intvelocity joint="wheel" kp="2" gear="3" ctrlrange="-3 3" actrange="-100 100"/>
<motor joint="pendulum" gear="10" ctrlrange="-0.01 0.01"/></actuator></mujoco>"""


def test_a_dataset_commands_positions_velocities_and_torques_at_once(tmp_path):
    (tmp_path / "mixed.xml").write_text(MIXED)
    out = tmp_path / "recorded"
    RecordSim(robot=str(tmp_path / "mixed.xml"), episodes=2, seconds=1.0, quantum=0.0, out=out).run()
    dataset = read(out)
    assert dataset.features["action"].names == ("servo.pos", "wheel.vel", "pendulum.effort")
    assert dataset.features["action"].units == ("rad", "rad/s", "N·m")
    largest = np.abs(dataset.commands).max(axis=0)
    assert (largest <= [1.0, 1.0, 0.1]).all() and largest[1] > 0.2 and largest[2] > 0.02
    simulator = MujocoSimulator.load(tmp_path / "mixed.xml", PERIOD, threads=1)
    paired = pair(dataset, simulator)
    rows = np.arange(dataset.n_frames) % 50 > 0  # the setpoint before an episode's first row is not told
    error = np.abs(paired.sim_states - dataset.next_states)[rows, :3].max(axis=0)
    assert (error < 2e-5).all()
    other = (tmp_path / "other.xml", MIXED.replace("<motor", "<velocity kv='1'"))
    other[0].write_text(other[1])
    with pytest.raises(JointMismatch, match="commands torques of pendulum, the model's actuator takes velocities"):
        pair(dataset, MujocoSimulator.load(other[0], PERIOD, threads=1))


@pytest.mark.parametrize(
    "kind", ["<velocity kv='2'", "<pid kp='20' kv='1' input='vel'", "<intvelocity kp='9' actrange='-1 1'"]
)
def test_effects_of_position_servos_are_refused_where_a_speed_is_commanded(load, kind):
    way = replace(PLAIN, group="velocity", actuator=kind + ' joint="{j}"/>', joint=HINGE)
    with pytest.raises(ModelFileError, match="needs a position servo"):
        load(way, "joint_offset:joint=a,offset=0.1")


def test_a_servo_is_preferred_to_other_actuators_of_its_joint(load):
    both = replace(PLAIN, actuator='<motor joint="{j}"/><velocity joint="{j}" kv="0.1"/>' + SERVO)
    simulator = load(both)
    assert simulator.kinds == (".pos", ".pos")
    assert simulator.layout.control.tolist() == [2, 5]


def test_an_actuator_that_the_model_switches_off_takes_no_command(load):
    both = '<position joint="{j}" kp="5" group="1"/><motor name="{j}_motor" joint="{j}"/>'
    on = replace(PLAIN, actuator=both)
    assert load(on).kinds == (".pos", ".pos")
    off = replace(on, after='<option actuatorgroupdisable="1"/>')
    assert load(off).kinds == (".effort", ".effort")


def test_what_a_plugin_is_asked_for_is_not_guessed(load):
    plugin = (
        '<extension><plugin plugin="mujoco.pid"><instance name="p"><config key="kp" value="5"/></instance></plugin>'
    )
    way = replace(
        PLAIN, actuator='<plugin joint="{j}" plugin="mujoco.pid" instance="p"/>', after=plugin + "</extension>"
    )
    with pytest.raises(ModelFileError, match=r"'a' of .* \(plugin\) has a control that is not a position, velocity or"):
        load(way)
