"""Every effect of the folder changes nothing when neutral, moves the robot, survives files, composes and is itself."""

import functools
import json
import math
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.simulator_samples import COUPLED_FINGERS, damped_ergojr, load_integrals, so101_without_floor
from support.typical_effects import JOINT, NAMES, OF_OBJECTS, TYPICAL, typical

from nas_data.effects.base import Effect, add_effects, find_effect, from_json, make_effect, parse, read_effects
from nas_data.errors import JointMismatch, ModelFileError, NasError, OptionError, UnknownName
from nas_data.robots.base import find_robot, list_actuated_joints
from nas_data.simulators.mujoco import MujocoSimulator

TABLE = Path(__file__).parents[1] / "support/table.xml"  # where a puck can be pushed
PERIOD = 0.01


def neutral(name: str) -> Effect:
    kind = find_effect(name)
    return kind.neutral(JOINT if kind.per_joint else None)


def scene(name: str) -> str:
    """Where an effect can act."""
    special = {"servo_damping": damped_ergojr, "floor_contact": so101_without_floor}
    return str(TABLE) if name in OF_OBJECTS else str(special.get(name, lambda: "ergojr")())


def arm(*effects: Effect, model: str | None = None) -> MujocoSimulator:
    model = model or (scene(effects[0].name()) if effects else "ergojr")
    return MujocoSimulator.load(model, PERIOD, effects=effects, threads=1)


def random_holds(seed: int = 0, holds: int = 6, joints: int = 6) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-0.9, 0.9, (1, holds, joints)), 50, axis=1)


def rollout(simulator: MujocoSimulator, commands: np.ndarray | None = None) -> np.ndarray:
    commands = random_holds(joints=len(simulator.joints)) if commands is None else commands
    return simulator.rollout(np.zeros((len(commands), 2 * commands.shape[2])), commands)


@functools.cache
def plain(model: str) -> np.ndarray:
    return rollout(arm(model=model))


def positions(states: np.ndarray) -> np.ndarray:
    return states[..., : states.shape[-1] // 2]


@pytest.mark.parametrize("name", NAMES)
def test_each_effect_says_what_it_is(name):
    kind = find_effect(name)
    assert kind.name() == name
    assert kind.__name__ == name.title().replace("_", "")
    assert kind.parameters
    assert all((kind.equation, kind.source, kind.signature, kind.confused_with))
    assert name not in kind.confused_with
    assert set(kind.confused_with) <= set(NAMES)
    for parameter in kind.parameters:
        assert parameter.low < parameter.high
        assert (name, parameter.name) in TYPICAL
        assert parameter.low <= TYPICAL[name, parameter.name] <= parameter.high


@pytest.mark.parametrize("name", NAMES)
def test_neutral_parameters_change_nothing(name):
    assert neutral(name).is_neutral
    assert np.array_equal(rollout(arm(neutral(name))), plain(scene(name)))


@pytest.mark.parametrize("name", NAMES)
def test_the_smallest_effect_is_hardly_seen(name):
    """Neutral is a limit, not a special case: next to it the robot moves as it does without."""
    kind = find_effect(name)
    finite = [p for p in kind.parameters if math.isfinite(p.neutral)]
    near = {p.name: p.neutral + 1e-5 * (TYPICAL[name, p.name] - p.neutral) for p in finite}
    near |= {p.name: 1e3 * p.high for p in kind.parameters if math.isinf(p.neutral)}
    if name in ("torque_limit", "motor_curve"):  # a limit is absolute: the model's own is the one that changes nothing
        near[find_effect(name).parameters[0].name] = 0.2079
    effect = make_effect(name, JOINT if kind.per_joint else None, near)
    # the engine delays by a whole timestep at least, and a play this small still adds a second joint
    close = rollout(arm(effect))
    slack = math.radians(3.0 if name == "command_delay" else 0.3)
    assert np.sqrt(np.mean(positions(close - plain(scene(name))) ** 2)) < slack


@pytest.mark.parametrize(("name", "parameter"), TYPICAL)
def test_each_parameter_moves_the_robot(name, parameter):
    """Against the effect without it; where that is neutral altogether, against the plain robot."""
    neutrals = {p.name: p.neutral for p in find_effect(name).parameters}
    effect, without = typical(name), typical(name, **{parameter: neutrals[parameter]})
    change = positions(rollout(arm(effect)) - rollout(arm(without)))
    assert np.isfinite(change).all()
    assert np.sqrt(np.mean(change**2, axis=(0, 1))).max() > math.radians(0.5)


@pytest.mark.parametrize("name", NAMES)
def test_joints_and_actuators_keep_their_names_and_order(name):
    robot = find_robot(scene(name))
    spec = robot.spec()
    before = spec.compile()
    add_effects(spec, [typical(name)])
    model = spec.compile()
    assert list_actuated_joints(spec) == robot.joints
    assert model.nu == len(robot.joints)
    names = [model.actuator(i).name for i in range(model.nactuator)]
    assert names[: before.nactuator] == [before.actuator(i).name for i in range(before.nactuator)]
    servos = [model.joint(i).name for i in range(model.njnt) if model.joint(i).name in robot.joints]
    assert servos == list(robot.joints)
    assert {f"{joint}.pos" for joint in servos} <= {model.sensor(i).name for i in range(model.nsensor)}


def plain_mujoco(xml: str, joints: Sequence[str], commands: np.ndarray, substeps: int) -> np.ndarray:
    """Play commands as anyone would who has the file and MuJoCo alone: at rest, first command held."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    for actuator in range(model.nactuator):
        samples = int(model.actuator_history[actuator, 0])
        if samples:
            mujoco.mj_initCtrlHistory(model, data, actuator, None, np.zeros((samples, 1)))
    load_integrals(model, data)
    sensors = [model.sensor(f"{joint}.pos").adr[0] for joint in joints]
    measured = []
    for command in commands:
        data.ctrl[:] = command
        mujoco.mj_step(model, data, substeps)
        mujoco.mj_forward(model, data)
        measured.append(data.sensordata[sensors].copy())
    return np.array(measured)


@pytest.mark.parametrize("name", NAMES)
def test_the_exported_file_behaves_the_same_in_plain_mujoco(name):
    """Or the effect says that the file alone cannot."""
    simulator = arm(typical(name))
    spec = find_robot(scene(name)).spec()
    spec.option.timestep = simulator.model.opt.timestep
    add_effects(spec, [typical(name)])
    commands = random_holds(seed=1, holds=3, joints=len(simulator.joints))
    measured = plain_mujoco(spec.to_xml(), simulator.joints, commands[0], simulator.substeps)
    difference = np.abs(measured - positions(rollout(simulator, commands))[0]).max()
    # the file keeps six digits; contacts and stops amplify what is lost
    assert (difference < math.radians(0.1)) == typical(name).in_model
    assert typical(name).in_model == (not simulator.hooks)


def swap_angle_unit(spec: mujoco.MjSpec) -> None:
    """Write a model's angles in degrees instead of radians, or in radians instead of degrees."""
    convert = np.radians if spec.compiler.degree else np.degrees
    spec.compiler.degree = not spec.compiler.degree
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE:
            joint.range, joint.ref, joint.springref = (convert(v) for v in (joint.range, joint.ref, joint.springref))


@pytest.mark.parametrize("joint", ["hinge", "slide"])
@pytest.mark.parametrize("name", NAMES)
def test_an_effect_is_the_same_in_a_model_in_degrees(name, joint):
    given, swapped = (find_robot(scene(name)).spec() for _ in range(2))
    for spec in (given, swapped):
        if joint == "slide" and find_effect(name).per_joint:
            spec.joint(JOINT).type = mujoco.mjtJoint.mjJNT_SLIDE
    swap_angle_unit(swapped)
    for spec in (given, swapped):
        add_effects(spec, [typical(name)])
    ends = []
    for spec in (given, swapped):
        data = mujoco.MjData(spec.compile())
        data.ctrl[:] = 0.3
        mujoco.mj_step(data.model, data, 200)
        ends.append(data.qpos)
    assert ends[1] == pytest.approx(ends[0], abs=1e-6), "edits.series.to_file_unit converts a position for the model"


def reading(angles: np.ndarray) -> np.ndarray:
    """Return the positions that an XL-320 with 0.29° resolution and 0.05° noise would have reported."""
    noise = np.random.default_rng(5).normal(size=angles.shape)
    quantum = math.radians(0.29)
    return np.round((angles + math.radians(0.05) * noise) / quantum) * quantum


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        pytest.param(
            name, parameter, marks=() if find_effect(name).parameters[0].name == parameter else pytest.mark.slow
        )
        for name, parameter in TYPICAL
    ],
)
def test_each_parameter_is_found_again_in_a_noisy_recording(name, parameter):
    truth = TYPICAL[name, parameter]
    joints = len(find_robot(scene(name)).joints)
    commands = np.concatenate([random_holds(seed=seed, holds=4, joints=joints) for seed in (3, 4)])
    measured = reading(positions(rollout(arm(typical(name)), commands)))
    bounds = next((p.low, p.high) for p in find_effect(name).parameters if p.name == parameter)

    def misfit(logarithm: float) -> float:
        value = float(np.clip(truth * math.exp(logarithm), *bounds))
        return float(np.mean((positions(rollout(arm(typical(name, **{parameter: value})), commands)) - measured) ** 2))

    # sticking makes the misfit rough: nested grids do not stop at the first dent
    found = 0.03  # so that no grid point is the truth
    for spacing in (0.25, 0.05):
        grid = found + spacing * np.arange(-2, 3)
        found = float(grid[np.argmin([misfit(point) for point in grid])])
    assert abs(found) < 0.05


def test_gravity_compensation_carries_a_payload_in_any_order_and_no_object():
    effects = [typical("payload"), typical("gravity_compensation")]
    for added in (effects, effects[::-1]):
        spec = find_robot(str(TABLE)).spec()
        add_effects(spec, added)
        assert spec.body("payload").gravcomp == 0.5 and spec.body("puck").gravcomp == 0


def test_gravity_compensation_carries_a_link_that_follows_from_the_base():
    spec = mujoco.MjSpec.from_string(COUPLED_FINGERS)
    add_effects(spec, [typical("gravity_compensation")])
    assert all(body.gravcomp == 0.5 for body in spec.bodies[1:])


SERVO_EFFECTS = ("backlash", "speed_limit", "command_delay", "servo_stiffness", "joint_offset", "torque_limit")


@pytest.mark.parametrize("added", [(), ("deadband",), ("stribeck_friction", "deadband"), ("load_friction", "deadband")])
def test_effects_on_one_joint_compose_in_any_order(added):
    effects = [typical(name) for name in (*SERVO_EFFECTS, *added)]
    commands = random_holds(seed=2, holds=2)
    rng = np.random.default_rng(0)
    orders = [[effects[i] for i in rng.permutation(len(effects))] for _ in range(8)]
    runs = [rollout(arm(*order), commands) for order in orders]
    assert max(np.abs(run - runs[0]).max() for run in runs) < 1e-9
    alone = rollout(arm(*effects[: len(SERVO_EFFECTS)]), commands)
    assert (np.abs(runs[0] - alone).max() > math.radians(0.5)) == bool(added)


@pytest.mark.parametrize("name", NAMES)
def test_json_and_typed_text_read_back_as_the_same_effect(name):
    effect = typical(name)
    assert from_json(json.loads(json.dumps(effect.to_json()))) == effect
    pairs = [f"{p.name}={getattr(effect, p.name)!r}" for p in effect.parameters]
    joint = [f"joint={effect.joint}"] if effect.joint else []
    assert parse(f"{name}:{','.join(joint + pairs)}") == effect


@given(st.sampled_from(NAMES), st.data())
def test_values_out_of_range_are_refused_and_others_kept(name, data):
    kind = find_effect(name)
    values = {}
    outside = False
    for p in kind.parameters:
        value = data.draw(st.floats(allow_nan=True, allow_infinity=True))
        values[p.name] = value
        outside |= not min(p.low, p.neutral) <= value <= max(p.high, p.neutral)
    joint = JOINT if kind.per_joint else None
    if outside:
        with pytest.raises(OptionError, match="must lie in"):
            make_effect(name, joint, values)
    else:
        assert all(getattr(make_effect(name, joint, values), key) == value for key, value in values.items())


def test_effects_files_hold_lists_or_reports(tmp_path):
    entries = [typical("backlash").to_json(), typical("base_tilt").to_json()]
    bare, report = tmp_path / "bare.json", tmp_path / "effects.json"
    bare.write_text(json.dumps(entries))
    report.write_text(json.dumps({"schema": 1, "effects": entries}))
    assert read_effects(bare) == read_effects(report) == (typical("backlash"), typical("base_tilt"))
    bare.write_text(json.dumps(entries), encoding="utf-8-sig")  # as Windows' Notepad saves it
    assert read_effects(bare) == read_effects(report)
    report.write_text("{}")
    with pytest.raises(OptionError, match=r"effects\.json"):
        read_effects(report)
    with pytest.raises(OptionError, match=r"There is no file .*none\.json; give the effects\.json of a gap report"):
        read_effects(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            '[{"effect": "backlash", "joint": "m3", "parameters": {"half_width": "wide"}}]',
            "half_width is 'wide'; a number",
        ),
        (
            '[{"effect": "backlash", "joint": "m3", "parameters": {"half_width": "0.02"}}]',
            "half_width is '0.02'; a number",
        ),
        ('[{"effect": "backlash", "joint": "m3", "parameters": {"half_width": {"value": "x"}}}]', "half_width is 'x'"),
        (
            '[{"effect": "backlash", "joint": "m3", "parameters": {"half_width": {"unit": "rad"}}}]',
            "half_width is None",
        ),
        ('[{"effect": "backlash", "joint": "m3", "parameters": {"half_width": [0.02]}}]', "half_width is \\[0.02\\]"),
        ('[{"effect": "backlash", "joint": "m3", "parameters": {"half_width": true}}]', "half_width is True"),
        ('[{"effect": "backlash", "joint": "m3", "parameters": {"half_width": NaN}}]', "half_width is nan"),
        ('[{"effect": "backlash", "joint": "m3", "parameters": 0.02}]', "must be an object of numbers"),
        ('["backlash"]', "'backlash' is not an effect"),
        ('{"effects": {"effect": "backlash"}}', "is not a list of effects"),
        ('[{"effect": ["backlash"]}]', "There is no effect"),
    ],
)
def test_an_effects_file_with_a_value_of_another_form_is_answered_with_its_name(tmp_path, content, said):
    path = tmp_path / "effects.json"
    path.write_text(content)
    with pytest.raises(OptionError, match=rf"effects\.json.*{said}"):
        read_effects(path)


def test_mistakes_are_answered_with_choices():
    with pytest.raises(UnknownName, match="backlash, base_tilt"):
        parse("gremlins:joint=m1")
    with pytest.raises(OptionError, match="half_width"):
        parse("backlash:joint=m3,width=0.1")
    with pytest.raises(OptionError, match=r"half_width, stiffness \(optional\); given: none\."):
        parse("backlash:joint=m3")
    with pytest.raises(OptionError, match="belongs to a joint"):
        parse("backlash:half_width=0.1")
    with pytest.raises(OptionError, match="whole arm"):
        parse("base_tilt:joint=m3,roll=0.1,pitch=0.0")
    with pytest.raises(OptionError, match="not a number"):
        parse("payload:mass=heavy")
    with pytest.raises(JointMismatch, match="m1, m2"):
        arm(typical("backlash", joint="elbow"))


TORQUE_ARM = """<mujoco><worldbody><body><joint name="j"/><geom size="0.1"/></body></worldbody>
<actuator><motor name="j" joint="j"/></actuator></mujoco>"""


@pytest.mark.parametrize("name", ["speed_limit", "servo_stiffness", "joint_offset", "deadband"])
def test_effects_of_a_servo_need_a_servo(name):
    with pytest.raises(ModelFileError, match="position"):
        add_effects(mujoco.MjSpec.from_string(TORQUE_ARM), [typical(name, joint="j")])


FILTERED = """<mujoco>
<worldbody><body><joint name="j" damping="0.1"/><geom size="0.05" pos="0.1 0 0"/></body></worldbody>
<actuator><position name="j" joint="j" kp="3" timeconst="0.05"/></actuator></mujoco>"""


def filtered_motion(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.3
    mujoco.mj_step(model, data, 50)
    return data.qpos


@pytest.mark.parametrize("name", NAMES)
def test_no_effect_fails_but_with_a_sentence(name):
    """On a model with filtered servos an effect works or refuses; it does not crash."""
    spec = mujoco.MjSpec.from_string(FILTERED)
    try:
        add_effects(spec, [typical(name, joint="j")])
    except NasError as error:
        reasons = {
            "servo_damping": "needs kv or dampratio",
            "speed_limit": "filters its command already",
            "integral_gain": "filters its command already",
            "object_mass": "has none",
            "object_friction": "has none",
            "floor_contact": "needs an arm with collision shapes",
        }
        assert reasons[name] in str(error)
    else:
        assert np.isfinite(filtered_motion(spec.compile())).all()
