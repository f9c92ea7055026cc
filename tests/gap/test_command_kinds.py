"""Missing effects of arms whose joints are commanded speeds or torques, and of slides."""

import mujoco
import numpy as np
import pytest

import nas_data as nas
from nas_data.effects.base import add_effects, parse
from nas_data.gap.finding.find import find
from nas_data.gap.problem import Problem
from nas_data.gap.report import GapReport

ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
<body pos="0 0 .5"><joint name="j" axis="0 1 0" range="-2 2" damping=".05" armature=".004" frictionloss=".01"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".01" mass=".15"/><body pos=".2 0 0">
<joint name="g" type="slide" axis="0 0 1" range="-.1 .1" damping="2" armature=".05" frictionloss=".05"/>
<geom type="box" size=".02 .02 .02" mass=".1"/></body></body></worldbody><actuator>{}</actuator></mujoco>"""
RAIL = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="g" type="slide" axis="0 0 1" range="-.1 .1" damping="2" frictionloss=".05" armature=".05"
/><geom size=".02" mass=".1"/></body></worldbody><actuator>{}</actuator></mujoco>"""
VELOCITY = '<velocity name="{0}" joint="{0}" kv="{1}"/>'
SERVOS = {  # model, and kind of the command of each joint
    "rail": (RAIL.format(VELOCITY.format("g", 20)), {"g": "velocity"}),
    "velocity": (ARM.format(VELOCITY.format("j", 1) + VELOCITY.format("g", 20)), {"j": "velocity", "g": "velocity"}),
    "setpoint": (
        ARM.format(
            '<intvelocity name="j" joint="j" kp="15" kv=".4" actrange="-3 3"/>'
            '<intvelocity name="g" joint="g" kp="300" kv="6" actrange="-1 1"/>'
        ),
        {"j": "velocity", "g": "velocity"},
    ),
    "mixed": (
        ARM.format('<position name="j" joint="j" kp="15" kv=".4"/>' + VELOCITY.format("g", 20)),
        {"j": "position", "g": "velocity"},
    ),
}
SIZE = {("velocity", "j"): 1.2, ("velocity", "g"): 0.12, ("position", "j"): 0.8}
HALF = {"j": 2.0, "g": 0.1}  # [rad], [m] half of each joint's range
RATE, ROWS, EPISODES = 50, 120, 5
NOISE = {"j": 3e-4, "g": 1e-4}  # [rad], [m]


def record(servos: str, hidden: str) -> nas.Dataset:
    """Record an arm with a hidden effect by a loop of its own, which begins after the arm has settled."""
    model_file, kinds = SERVOS[servos]
    spec = mujoco.MjSpec.from_string(model_file)
    add_effects(spec, [parse(hidden)] if hidden else [])
    model, rng, n = spec.compile(), np.random.default_rng(0), len(kinds)
    sizes, halves = (
        np.array(each) for each in ([SIZE[kind, name] for name, kind in kinds.items()], [*map(HALF.get, kinds)])
    )
    speeds_asked = np.array([kind == "velocity" for kind in kinds.values()])
    positions, commands, times = [], [], np.arange(ROWS)[:, None] / RATE
    for _ in range(EPISODES):
        data = mujoco.MjData(model)
        speeds, phases = rng.uniform(1.5, 7.0, (3, n)), rng.uniform(0, 2 * np.pi, (3, n))
        asked = sum(np.sin(times * speed + phase) - np.sin(phase) for speed, phase in zip(speeds, phases, strict=True))
        asked = asked * sizes / 2
        asked[:5] = 0.0
        mujoco.mj_step(model, data, 150)
        rows = [[data.joint(name).qpos[0] for name in kinds]]
        for row in asked:
            share = np.array(rows[-1]) / halves  # a velocity command turns the joint round before its end
            row -= np.where(speeds_asked & (np.abs(share) > 0.5), share * sizes, 0.0)
            data.ctrl[:] = row
            mujoco.mj_step(model, data, round(1 / RATE / model.opt.timestep))
            rows.append([data.joint(name).qpos[0] for name in kinds])
        noise = rng.normal(size=(ROWS + 1, n)) * [*map(NOISE.get, kinds)]
        positions.append(np.array(rows) + noise)
        commands.append(asked)
    return nas.Dataset.from_arrays(
        positions, commands, rate=RATE, joints=[*kinds], slides=("g",), kind=[*kinds.values()]
    )


def identify(folder, servos: str, hidden: str) -> GapReport:
    (folder / "arm.xml").write_text(SERVOS[servos][0])
    return nas.identify(record(servos, hidden), model=folder / "arm.xml")


def test_the_signs_of_joints_that_are_not_commanded_positions_are_said_to_be_unknown(tmp_path):
    (tmp_path / "arm.xml").write_text(SERVOS["mixed"][0])
    problem = Problem.of(record("mixed", ""), tmp_path / "arm.xml", None)
    found = find(problem.dataset, problem.evidence, problem.as_given, problem.train.floor)
    (signs,) = [check for check in found.audit if check.check == "signs"]
    assert signs.ok and signs.finding.endswith("Not compared, because their commands are not positions: g.")


@pytest.mark.slow
@pytest.mark.parametrize("servos", ["setpoint", "velocity", "mixed"])
def test_nothing_is_named_where_nothing_hides(servos, tmp_path):
    """Setpoints that hold the arm's weight are ahead of their joints when the recording begins."""
    report = identify(tmp_path, servos, "")
    assert report.effects == () and report.verdict in {"none", "retuned"}


@pytest.mark.parametrize(
    ("servos", "hidden", "unit"),
    [
        ("rail", "servo_damping:joint=g,factor=0.3", ""),
        pytest.param("rail", "speed_limit:joint=g,speed=0.08", "m/s", marks=pytest.mark.slow),
        pytest.param("velocity", "servo_damping:joint=g,factor=0.3", "", marks=pytest.mark.slow),
        pytest.param("velocity", "servo_damping:joint=j,factor=3", "", marks=pytest.mark.slow),
        pytest.param("velocity", "speed_limit:joint=j,speed=0.8", "rad/s", marks=pytest.mark.slow),
        pytest.param("velocity", "torque_limit:joint=g,torque=1.6", "N", marks=pytest.mark.slow),
        pytest.param("velocity", "command_delay:delay=0.04", "s", marks=pytest.mark.slow),
        pytest.param("velocity", "viscous_friction:joint=j,coefficient=0.5", "N·m·s/rad", marks=pytest.mark.slow),
        pytest.param("setpoint", "command_delay:delay=0.04", "s", marks=pytest.mark.slow),
        pytest.param("setpoint", "servo_stiffness:joint=j,factor=0.3", "", marks=pytest.mark.slow),
        pytest.param("setpoint", "coulomb_friction:joint=g,torque=0.5", "N", marks=pytest.mark.slow),
        pytest.param("mixed", "joint_offset:joint=j,offset=0.05", "rad", marks=pytest.mark.slow),
        pytest.param("mixed", "viscous_friction:joint=g,coefficient=10", "N·s/m", marks=pytest.mark.slow),
        pytest.param("mixed", "command_delay:delay=0.04", "s", marks=pytest.mark.slow),
    ],
)
def test_the_hidden_effect_is_named(servos, hidden, unit, tmp_path):
    report, effect = identify(tmp_path, servos, hidden), parse(hidden)
    assert [(found.name, found.joint) for found in report.effects] == [(effect.name(), effect.joint)]
    ((name, value),) = report.effects[0].parameters.items()
    assert value.value == pytest.approx(getattr(effect, name), rel=0.15) and value.unit == unit
    assert report.verdict == "explained"


@pytest.mark.slow
@pytest.mark.parametrize("servos", ["setpoint", "velocity", "mixed"])
def test_a_payload_is_named_whatever_is_commanded(servos, tmp_path):
    """It keeps joints that are commanded velocities in motion from the first row, where the true model errs, too."""
    report = identify(tmp_path, servos, "payload:mass=0.15")
    assert [(found.name, found.joint) for found in report.effects] == [("payload", None)]
    assert report.effects[0].parameters["mass"].value == pytest.approx(0.15, rel=0.1)
    assert report.gap.after < 0.15 * report.gap.before
