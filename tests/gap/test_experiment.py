"""What to record next: within limits, playable, and the best of what was tried at telling two explanations apart."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.command_samples import done
from support.simulator_samples import COUPLED_FINGERS
from support.two_joint_arm import ARM

from nas_data.command_file import check_limits, read_commands
from nas_data.dataset.read import read
from nas_data.effects.backlash import Backlash
from nas_data.effects.coulomb_friction import CoulombFriction
from nas_data.effects.payload import Payload
from nas_data.errors import OptionError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.experiments.command_limits import SPEED, CommandRange, mask_joints
from nas_data.gap.experiments.discrimination import compute_separations, find_differing_joints, make_batch
from nas_data.gap.experiments.experiment import (
    Explanation,
    choose_next_experiment,
    describe_experiment,
    write_experiment,
)
from nas_data.gap.experiments.library import KINDS, STEPS, is_harmless
from nas_data.gap.nominal import Nominal

JOINTS = ("shoulder", "elbow")
PLAY = Explanation((Backlash(joint="elbow", half_width=0.02),), {"elbow.gain": 1.05})
FRICTION = Explanation((CoulombFriction(joint="elbow", torque=0.004),), {"elbow.gain": 0.97, "shoulder.damping": 1.1})
FLOOR = np.full(2, np.radians(0.29) / np.sqrt(12))

HINGE = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody><body>
    <joint name="hip" axis="0 1 0" damping="0.1"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
  </body></worldbody>
  <actuator><motor joint="hip" {limits}/></actuator>
</mujoco>
"""


def nominal_of(model, joints, period=0.01):
    return Nominal.load(model, nothing(joints, period))


def nothing(joints, period, speed=0.0):
    rows = np.zeros((1, 10, len(joints)))
    measured = rows + speed * period * np.arange(10)[:, None]
    counts = np.ones((1, 10), bool)
    return EpisodeBatch(joints, period, np.zeros((1, len(joints))), rows, measured, counts, np.arange(1))


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM.replace('timestep="0.002"', 'timestep="0.005"'))
    return nominal_of(path, JOINTS)


@pytest.fixture(scope="module")
def experiment(arm):
    return choose_next_experiment(arm, nothing(JOINTS, 0.01), PLAY, [FRICTION], FLOOR, seed=3)


def test_of_many_different_effects_only_some_are_listed(experiment):
    many = [CoulombFriction(joint=joint, torque=0.004) for joint in ("shoulder", "elbow", "wrist", "gripper")]
    text = describe_experiment(experiment.table[0], Explanation(tuple(many), {}), [PLAY], JOINTS)
    assert "separates coulomb friction in shoulder and coulomb friction in elbow and 2 more from backlash" in text


def test_the_file_is_played_by_the_recorder(experiment, tmp_path):
    write_experiment(experiment, tmp_path / "next.csv")
    (tmp_path / "arm.xml").write_text(ARM)
    options = ("--robot", tmp_path / "arm.xml", "--rate", "100", "--commands", tmp_path / "next.csv")
    done("record", "sim", *options, "--out", tmp_path / "recorded")
    recorded = read(tmp_path / "recorded")
    np.testing.assert_allclose(recorded.commands, experiment.commands, atol=1e-6)
    assert recorded.fps == pytest.approx(1 / experiment.period)


def test_every_experiment_starts_at_rest_slowly_and_stays_within_limits(arm, experiment, tmp_path):
    room = CommandRange.of(arm, nothing(JOINTS, 0.01))
    for row in experiment.table:
        commands = row.trial.commands
        check_limits(tmp_path, experiment.names, [commands], room.low, room.high)
        np.testing.assert_array_equal(commands[0], room.home)
        first = commands[: room.steps(1.0)]
        assert np.abs(np.diff(first, axis=0)).max() <= SPEED * room.period * 1.01
        assert 10 <= row.seconds <= 20


def test_the_chosen_experiment_separates_the_rivals_at_least_as_well_as_every_other(arm, experiment):
    commands = [row.trial.commands for row in experiment.table]
    evidence = make_batch(arm, commands, CommandRange.of(arm, nothing(JOINTS, 0.01)).pose)
    again = compute_separations(arm, (PLAY, FRICTION), nothing(JOINTS, 0.01), evidence, FLOOR, ("elbow",)).max(axis=1)
    np.testing.assert_allclose(again, [row.separation for row in experiment.table], rtol=1e-6)
    assert again.argmax() == 0
    np.testing.assert_array_equal(commands[0], experiment.commands)
    assert {row.trial.name for row in experiment.table} == set(KINDS)


def test_the_sentence_names_the_experiment_and_both_rivals(experiment):
    best = experiment.table[0]
    assert best.separation > 1
    assert experiment.text.startswith(f"{best.trial.name} on ")
    assert "separates backlash from coulomb friction" in experiment.text
    assert f"{best.separation:.1f} times the noise" in experiment.text
    assert experiment.decides


def test_an_experiment_is_chosen_against_all_rivals(arm, experiment):
    """One rival needs the elbow, the other the shoulder: the choice tells more than those against one of them."""
    heavy = Explanation((*PLAY.effects, CoulombFriction(joint="shoulder", torque=0.05)), {"elbow.gain": 1.05})
    light = Explanation((CoulombFriction(joint="elbow", torque=0.004), *heavy.effects[1:]), FRICTION.factors)
    found = choose_next_experiment(arm, nothing(JOINTS, 0.01), heavy, [light, PLAY], FLOOR, seed=3)
    best = found.table[0]
    assert len(best.separations) == 2 and min(best.separations) > 1
    assert best.information == max(row.information for row in found.table)
    assert {joint for row in found.table for joint in row.trial.moved} == set(JOINTS)
    for text in ("backlash from coulomb friction", "coulomb friction from no further effect"):
        assert text in found.text
    assert "; also " in found.text
    same = choose_next_experiment(arm, nothing(JOINTS, 0.01), heavy, [light, heavy], FLOOR, seed=3)
    assert "; not no further effect from no further effect" in same.text


def test_a_rival_that_follows_differs_less_than_one_that_does_not(arm, experiment):
    chosen = make_batch(arm, [experiment.commands], CommandRange.of(arm, nothing(JOINTS, 0.01)).pose)
    one, two = (arm.predict(chosen, rival.effects, rival.factors) for rival in (PLAY, FRICTION))
    fixed = float(np.sqrt(((one - two)[..., 1] ** 2).mean()) / FLOOR[1])
    assert experiment.table[0].separation < fixed


def test_rivals_that_are_the_same_are_said_to_be_inseparable(arm, experiment):
    chosen = make_batch(arm, [experiment.commands], CommandRange.of(arm, nothing(JOINTS, 0.01)).pose)
    apart = compute_separations(arm, (PLAY, PLAY), nothing(JOINTS, 0.01), chosen, FLOOR, ("elbow",))
    assert apart.max() < 0.5
    worst = experiment.table[0].__class__(experiment.table[0].trial, (float(apart.max()),), ("elbow",), 12.0)
    assert describe_experiment(worst, PLAY, [FRICTION], JOINTS).startswith(
        "no simulated experiment separates backlash from"
    )
    assert not replace(experiment, table=(worst,)).decides


def test_if_no_experiment_separates_the_rivals_all_joints_move_in_steps(arm):
    found = choose_next_experiment(arm, nothing(JOINTS, 0.01), PLAY, [PLAY], FLOOR, seed=3)
    assert not found.decides
    (steps,) = (row for row in found.table if row.trial.name == STEPS and row.trial.moved == JOINTS)
    np.testing.assert_array_equal(found.commands, steps.trial.commands)


def test_rivals_of_one_name_are_told_apart_by_their_joints(experiment):
    other = Explanation((Backlash(joint="shoulder", half_width=0.02),), {})
    text = describe_experiment(experiment.table[0], PLAY, [other], JOINTS)
    assert "separates backlash in elbow from backlash in shoulder" in text
    assert find_differing_joints((PLAY, other), JOINTS) == JOINTS


def test_an_effect_of_the_whole_arm_concerns_every_joint():
    loaded = Explanation((Payload(joint=None, mass=0.02), *PLAY.effects), {})
    assert find_differing_joints((PLAY, loaded), JOINTS) == JOINTS
    assert find_differing_joints((PLAY, FRICTION), JOINTS) == ("elbow",)


def test_an_experiment_that_hits_the_floor_is_seen_to():
    ergojr = nominal_of("ergojr", ("m1", "m2", "m3", "m4", "m5", "m6"))
    room = CommandRange.of(ergojr, nothing(ergojr.joints, 0.01))
    down = room.ramp(room.pose, np.array([0.0, -1.5, -1.5, 0.0, -1.5, 0.0]), 1.0)
    up = room.ramp(room.pose, np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 1.0)
    harmless = [is_harmless(ergojr, Explanation((), {}), room, commands) for commands in (up, down, -down)]
    assert harmless[0] and not all(harmless)


def test_an_experiment_in_which_a_finger_that_follows_hits_something_is_seen_to(tmp_path):
    (tmp_path / "fingers.xml").write_text(COUPLED_FINGERS)
    fingers = nominal_of(tmp_path / "fingers.xml", ("finger",))
    room = CommandRange.of(fingers, nothing(("finger",), 0.01))
    ways = [room.ramp(room.pose, np.array([goal]), 0.1) for goal in (0.03, 0.06)]
    assert [is_harmless(fingers, Explanation((), {}), room, commands) for commands in ways] == [True, False]


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 999), low=st.floats(-3, -0.1), high=st.floats(0.1, 3), share=st.floats(0.1, 1))
def test_a_reduced_room_lies_within_the_room_and_keeps_its_home(seed, low, high, share):
    room = CommandRange(0.02, np.zeros(2), np.zeros(2), np.array([low, -1.0]), np.array([high, 1.0]))
    part = room.shrink(share)
    for draw in KINDS.values():
        commands = part.prepend_approach(draw(part, mask_joints(("a", "b"), ("a",)), np.random.default_rng(seed)))
        assert (commands >= room.low - 1e-12).all()
        assert (commands <= room.high + 1e-12).all()
        np.testing.assert_array_equal(commands[0], room.home)


def choose_torques(folder, limit, speed):
    (folder / "hinge.xml").write_text(HINGE.format(limits=f'ctrlrange="-{limit} {limit}" ctrllimited="true"'))
    nominal = nominal_of(folder / "hinge.xml", ("hip",), 0.02)
    leader = Explanation((CoulombFriction(joint="hip", torque=0.1),), {})
    recorded = nothing(("hip",), 0.02, speed)
    return (
        nominal,
        leader,
        choose_next_experiment(nominal, recorded, leader, [Explanation((), {})], np.full(1, 1e-3), seed=0),
    )


def test_an_arm_that_takes_torques_gets_torques(tmp_path):
    _, _, found = choose_torques(tmp_path, limit=1, speed=20.0)
    assert found.names == ("hip.effort",)
    assert "separates coulomb friction from no further effect" in found.text
    write_experiment(found, tmp_path / "next.csv")
    np.testing.assert_array_equal(read_commands(tmp_path / "next.csv", found.names)[0], found.commands)


def test_torques_move_no_joint_more_than_twice_as_fast_as_recorded(tmp_path):
    """The limit of the motor would turn the hinge many times as fast."""
    nominal, leader, found = choose_torques(tmp_path, limit=4, speed=2.0)
    for row in found.table:
        batch = make_batch(nominal, [row.trial.commands], np.zeros(1))
        path = nominal.predict(batch, leader.effects, leader.factors)[0]
        assert np.abs(np.diff(path, axis=0)).max() <= 2 * 2.0 * 0.02 + 1e-9
        assert np.abs(row.trial.commands).max() > 0.1


def test_no_experiment_is_proposed_if_each_would_harm_the_arm(tmp_path):
    with pytest.raises(OptionError, match="more than twice as fast as recorded"):
        choose_torques(tmp_path, limit=4, speed=0.0)


def test_torques_without_limits_are_refused(tmp_path):
    (tmp_path / "hinge.xml").write_text(HINGE.format(limits=""))
    with pytest.raises(OptionError, match="no limits"):
        CommandRange.of(nominal_of(tmp_path / "hinge.xml", ("hip",), 0.02), nothing(("hip",), 0.02))
