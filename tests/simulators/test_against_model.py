"""A joint whose sign contradicts gravity is reported by import and `nas gap find`, even if it bears little load."""

import mujoco
import numpy as np
import pytest

from nas_data.dataset.audits.base import AuditFinding
from nas_data.dataset.dataset import Dataset
from nas_data.simulators.against_model import check, check_signs

# The shoulder holds 3 N·m at most, the elbow 0.3 N·m.
ARM = """<mujoco><option timestep="0.002" integrator="implicitfast"/><compiler angle="radian"/><worldbody><body>
<joint name="shoulder" axis="0 1 0" damping="1"/><geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1"/>
<body pos=".3 0 0"><joint name="elbow" axis="0 1 0" damping=".1"/>
<geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass=".3"/></body></body></worldbody><actuator>
<position joint="shoulder" kp="40" kv="2"/><position joint="elbow" kp="4" kv=".2"/></actuator></mujoco>"""
# Gravity compensation carries the arm, and the servos hold springs.
COMPENSATED = ARM.replace("<body", '<body gravcomp="1"').replace("<joint", '<joint stiffness="1" springref="-2"')
# A counterweight turns against the shoulder, and weighs more than the arm.
BALANCED = ARM.replace(
    "</worldbody>",
    """<body><joint name="balance" axis="0 1 0" damping="1"/>
<geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="3" contype="0" conaffinity="0"/></body></worldbody>
<equality><joint joint1="balance" joint2="shoulder" polycoef="0 -1 0 0 0"/></equality>""",
)
RATE, HOLD, POSES = 50, 75, 8


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    return tmp_path / "arm.xml"


def recorded(signs: tuple[float, float], text: str = ARM) -> Dataset:
    """Poses that the arm holds, as an arm whose joints count with these signs reports them."""
    model = mujoco.MjModel.from_xml_string(text)
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    positions, commands = [], []
    for pose in rng.uniform(-1.2, 1.2, (POSES, 2)):
        for _ in range(HOLD):
            positions.append(data.qpos[:2].copy())
            commands.append(pose)
            data.ctrl[:] = pose
            mujoco.mj_step(model, data, 10)
    return Dataset.from_arrays(
        np.array(positions) * signs, np.array(commands) * signs, rate=RATE, joints=("shoulder", "elbow")
    )


@pytest.mark.parametrize(("signs", "wrong"), [((1, 1), ""), ((-1, 1), "shoulder"), ((1, -1), "elbow")])
def test_a_sign_that_contradicts_gravity_is_found(arm, signs, wrong):
    found = check_signs(recorded(signs), mujoco.MjModel.from_xml_string(ARM))
    assert any(finding.what.startswith(f"{wrong} has the wrong sign") for finding in found) if wrong else found == []


@pytest.mark.parametrize("kind", ["velocity", "torque"])
@pytest.mark.parametrize(("signs", "wrong"), [((1, 1), ""), ((1, -1), "elbow")])
def test_a_sign_is_found_beside_a_joint_without_a_position_servo(arm, signs, wrong, kind):
    """What holds the shoulder is a changing torque, or a speed of zero; the elbow is a position servo."""
    held = recorded(signs)
    first = np.zeros(held.n_frames) if kind == "velocity" else 0.1 * (np.arange(held.n_frames) % 2)
    mixed = Dataset.from_arrays(
        held.states[:, :2],
        np.column_stack([first, held.commands[:, 1]]),
        rate=RATE,
        joints=held.joints,
        kind=(kind, "position"),
    )
    found = check_signs(mixed, mujoco.MjModel.from_xml_string(ARM))
    assert [finding.what.split()[0] for finding in found] == ([wrong] if wrong else [])
    assert any(wrong in finding.what for finding in check(mixed, arm)) if wrong else check(mixed, arm) == []


@pytest.mark.parametrize("text", [COMPENSATED, BALANCED], ids=["compensated", "balanced"])
def test_what_the_servos_need_not_hold_contradicts_nothing(arm, text):
    arm.write_text(text)
    assert check(recorded((1, 1), text), arm) == []


def test_a_wrong_sign_is_found_beside_a_counterweight():
    found = check_signs(recorded((-1, 1), BALANCED), mujoco.MjModel.from_xml_string(BALANCED))
    assert [finding.what.split()[0] for finding in found] == ["shoulder"]


def test_where_a_sign_differs_from_the_commands_no_other_cause_is_suggested(arm):
    known = AuditFinding("command_sign", "the dataset", "the shoulder moves against its command")
    assert check(recorded((-1, 1)), arm)
    assert check(recorded((-1, 1)), arm, known=[known]) == []


@pytest.mark.parametrize(("offset", "told"), [((2.0, 0.0), False), ((2.0, 2.0), False), ((2.0, -2.0), True)])
def test_an_exchange_is_suggested_only_where_it_takes_both_joints_into_their_limits(arm, offset, told):
    limited = ARM.replace('name="shoulder"', 'name="shoulder" range="-3.4 -0.7" limited="true"').replace(
        'name="elbow"', 'name="elbow" range="0.7 3.4" limited="true"'
    )
    arm.write_text(limited)
    dataset = recorded((1, 1))
    moved = Dataset.from_arrays(
        dataset.states[:, :2] + offset, dataset.commands + offset, rate=RATE, joints=("shoulder", "elbow")
    )
    found = [finding.message for finding in check(moved, arm) if finding.check == "model_limits"]
    assert found and any("if both were exchanged" in message for message in found) is told


def test_gap_find_says_that_a_joint_hangs_upwards(arm):
    from nas_data.dataset.cutting import cut_every
    from nas_data.gap.finding.find import find
    from nas_data.gap.problem import Problem

    for signs, ok in (((1, 1), True), ((1, -1), False)):
        dataset = cut_every(recorded(signs), 1.5)
        problem = Problem.of(dataset, arm, arm.parent)
        found = find(dataset, problem.evidence, problem.as_given, problem.train.floor, problem.overlaps)
        (signs_found,) = [entry for entry in found.audit if entry.check == "signs"]
        assert signs_found.ok is ok
        assert ("elbow has the wrong sign" in signs_found.finding) is not ok
