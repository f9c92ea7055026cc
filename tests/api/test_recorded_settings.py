"""Position gains and torque that a recording holds, in evaluation, pairing, training and films."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nas_data as nas
from nas_data.api.pairing import PairingSource, make_pairs
from nas_data.dataset.audits import audit_dataset
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import Feature
from nas_data.dataset.position_gains import P_GAIN_COLUMN
from nas_data.dataset.torque_off import TORQUE, drop_rows_without_torque, follow_shutdowns
from nas_data.effects.base import parse
from nas_data.errors import DatasetInvalid, JointMismatch, OptionError
from nas_data.gap.problem import Problem
from nas_data.models.presets import preset
from nas_data.pairing import check_source
from nas_data.reports.films.motion import follow
from nas_data.simulators.engines import ENGINES
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.simulators.servo_registers import ServoRegisters, group_by_registers

MODEL = Path(__file__).parents[2] / "docs/results/xl330.xml"  # states the register of its gain, 400
PERIOD, STEPS, ON = 0.005, 160, 60
GAINS = (100, 400, 100, 800)
SAME = 1e-4  # [rad]


def record(gains: tuple[int, ...] = GAINS, on: int = STEPS) -> Dataset:
    """Record a simulated pendulum at position gains, with its torque off after some rows."""
    lift = np.minimum(np.arange(STEPS) / 40, 1.0)
    commands = np.linspace(0.4, 1.2, len(gains))[:, None, None] * lift[:, None]
    states = []
    for gain, own in zip(gains, commands, strict=True):
        stiffness = [parse(f"servo_stiffness:joint=pendulum,factor={gain / 400}")] if gain != 400 else []
        simulator = MujocoSimulator.load(MODEL, PERIOD, effects=stiffness, threads=1)
        after = simulator.rollout(np.zeros((1, 2)), own[None], torque_off_from=np.array([on]))[0]
        states.append(np.concatenate([np.zeros((1, 2)), after]))
    positions, velocities = ([each[:, part : part + 1] for each in states] for part in (0, 1))
    dataset = Dataset.from_arrays(
        positions, list(commands), velocities=velocities, rate=1 / PERIOD, joints=["pendulum"], robot="pendulum"
    )
    powered = np.tile(np.arange(STEPS) < on, len(gains))[:, None].astype(np.float32)
    known = {P_GAIN_COLUMN: np.repeat(gains, STEPS)[:, None].astype(np.float32), TORQUE: powered}
    for name, column in known.items():
        dataset = dataset.with_column(name, Feature((name,)), column)
    return dataset


@pytest.mark.parametrize("on", [STEPS, ON])
def test_a_model_is_evaluated_at_each_episode_s_gain_and_without_torque_where_it_is_off(on: int):
    found = nas.evaluate(MODEL, record(on=on), plain_fit=False)
    assert np.max(found.open_loop["source"].per_episode) < SAME
    assert np.max(found.one_step["source"].per_episode) < SAME
    assert any("Episodes 0,2: " in note and "multiplied by 0.25" in note for note in found.notes)
    assert any("servos are off" in note for note in found.notes) == (on < STEPS)


def test_without_these_columns_the_same_motion_is_not_explained():
    known = record(on=ON)
    unknown = known.without_columns([P_GAIN_COLUMN, TORQUE])
    errors = nas.evaluate(MODEL, unknown, plain_fit=False).open_loop["source"].per_episode
    assert min(errors) > 0.01
    deaf = known.without_columns([TORQUE])
    assert nas.evaluate(MODEL, deaf, plain_fit=False).open_loop["source"].per_episode[1] > 0.01


def test_predictors_keep_the_order_of_the_episodes():
    dataset = record()
    whole = nas.evaluate(MODEL, dataset, plain_fit=False)
    alone = [nas.evaluate(MODEL, dataset, episodes=[number], plain_fit=False) for number in range(len(GAINS))]
    for name, errors in whole.open_loop.items():
        assert errors.per_episode == pytest.approx([one.open_loop[name].per_episode[0] for one in alone])


def test_a_model_with_another_gain_is_compared_at_the_same_register(tmp_path: Path):
    other = tmp_path / "other.xml"
    other.write_text(MODEL.read_text().replace('data="400"', 'data="200"'))  # the same gain, said of another register
    found = nas.evaluate(other, record((200, 200)), model=MODEL, plain_fit=False)
    half, whole = found.open_loop["source"].per_episode, found.open_loop["model"].per_episode
    assert max(half) < SAME < 0.01 < min(whole)


def test_the_plain_fit_is_made_at_the_recording_s_one_gain():
    once = nas.evaluate(MODEL, record((200, 200, 200)))
    assert once.open_loop["plain fit"].overall < 0.01
    several = nas.evaluate(MODEL, record((200, 400, 200)))
    assert "plain fit" not in several.open_loop
    assert any("its episodes differ in p_gain" in note for note in several.notes)


def test_pairs_are_predicted_without_torque_where_it_is_off():
    dataset = record((400, 400), on=ON)
    paired = nas.pair(dataset, MODEL)
    assert np.abs(paired.sim_states - dataset.next_states)[:, 0].max() < SAME
    deaf = nas.pair(dataset.without_columns([TORQUE]), MODEL)
    assert np.abs(deaf.sim_states - dataset.next_states)[ON:STEPS, 1].max() > 0.01


def test_pairing_says_that_the_gains_differ():
    remarks = make_pairs(record(), PairingSource(model=MODEL)).remarks
    assert any("p_gain differ between episodes" in remark for remark in remarks)
    assert any("multiplied by 0.5" in one for one in make_pairs(record((200, 200)), PairingSource(model=MODEL)).remarks)


def test_training_leaves_out_rows_without_torque():
    small = preset("fast", hidden=4, updates=1)
    lines: list[str] = []
    learned = nas.train_forward(record((400, 400, 400), on=ON), preset=small, progress=lines.append)
    assert any(f"{3 * ON} transitions" in line for line in lines)
    assert any(f"{3 * (STEPS - ON)} rows" in line for line in lines)
    found = nas.evaluate(learned, record((400, 400, 400), on=ON), plain_fit=False)
    assert found.open_loop["hold"].lengths.tolist() == [ON] * 3


def test_episodes_without_torque_are_left_out():
    dataset = record((400, 400, 400), on=ON)
    torque = dataset.columns[TORQUE].copy()
    torque[STEPS : 2 * STEPS] = 0
    dataset = replace(dataset, columns={**dataset.columns, TORQUE: torque})
    driven, told = drop_rows_without_torque(dataset)
    assert driven.episode_numbers == (0, 2)
    assert driven.lengths.tolist() == [ON, ON]
    assert f"{STEPS + 2 * (STEPS - ON)} rows" in told[0]
    fallen, _ = follow_shutdowns(dataset)
    assert fallen.lengths.tolist() == [STEPS, STEPS]
    with pytest.raises(DatasetInvalid, match="off in every row"):
        drop_rows_without_torque(replace(dataset, columns={**dataset.columns, TORQUE: 0 * torque}))


def test_a_film_has_the_episode_s_gain_and_shutdown():
    dataset = record(on=ON).select([3])
    ghost = follow(dataset, 3, [str(MODEL)]).ghosts[1]
    assert ghost.errors.max() < SAME
    assert len(ghost.states) == STEPS + 1


def test_evaluation_and_gap_agree():
    dataset = record((100, 400, 800), on=ON)
    problem = Problem.of(dataset, MODEL, None)
    seen = problem.evidence
    predicted = problem.as_given.predict(seen)
    assert np.sqrt(seen.mean_squares(predicted)).max() < SAME


def test_phi_is_not_learned_on_gains_that_it_cannot_tell_apart(tmp_path: Path):
    with pytest.raises(OptionError, match=r"nas.p_gain.*leave out --learn"):
        nas.identify(record(), model=MODEL, learn=5, out=tmp_path / "gap")


def two_joints(torque: np.ndarray) -> Dataset:
    """Episodes of two joints, whose torque (E, T, 2) is on or off."""
    count, rows, _ = torque.shape
    still = [np.zeros((rows, 2)) for _ in range(count)]
    dataset = Dataset.from_arrays(still, still, rate=50, joints=["a", "b"])
    kept = np.concatenate([each[: dataset.lengths[0]] for each in torque]).astype(np.float32)
    return dataset.with_column(TORQUE, Feature(("a", "b")), kept)


def test_rows_in_which_some_servos_are_off_are_left_out():
    torque = np.ones((2, 40, 2))
    torque[:, 20:, 1] = 0
    torque[1, 30:] = 0
    kept, told = follow_shutdowns(two_joints(torque))
    assert kept.lengths.tolist() == [20, 20]
    assert len(told) == 1
    torque[1, 20:] = 0
    kept, told = follow_shutdowns(two_joints(torque))
    assert kept.lengths.tolist() == [20, 39]
    assert "servos are off" in told[0]


def test_a_servo_that_never_has_torque_is_named():
    torque = np.ones((2, 40, 2))
    torque[..., 1] = 0
    with pytest.raises(DatasetInvalid, match=r"torque of b is off .* the dataset .*all servos switched on"):
        follow_shutdowns(two_joints(torque))
    torque[1] = 1
    with pytest.raises(DatasetInvalid, match=r"episode 0 of the dataset .*other episodes"):
        follow_shutdowns(two_joints(torque).select([0]))


def test_gains_count_where_the_torque_is_on():
    dataset = record((100, 400), on=ON)
    gains = dataset.columns[P_GAIN_COLUMN].copy()
    gains[(np.arange(len(gains)) % STEPS) >= ON] = 0  # as servos report it without torque
    dataset = replace(dataset, columns={**dataset.columns, P_GAIN_COLUMN: gains})
    found = nas.evaluate(MODEL, dataset, plain_fit=False)
    assert np.max(found.open_loop["source"].per_episode) < SAME
    assert Problem.of(dataset, MODEL, None).evidence.gains.ravel().tolist() == [0.25, 1.0]
    assert follow(dataset.select([0]), 0, [str(MODEL)]).ghosts[1].errors.max() < SAME


def test_pairing_does_not_need_the_gains():
    dataset = record((400, 400))
    gains = dataset.columns[P_GAIN_COLUMN].copy()
    gains[20:40] = 800
    dataset = replace(dataset, columns={**dataset.columns, P_GAIN_COLUMN: gains})
    pairing = make_pairs(dataset, PairingSource(model=MODEL))
    assert pairing.dataset.paired
    assert any("p_gain differ" in remark for remark in pairing.remarks)
    learned = nas.train_forward(dataset, preset=preset("fast", hidden=4, updates=1))
    assert nas.evaluate(learned, dataset, model=MODEL, plain_fit=False).open_loop["hold"].overall > 0
    with pytest.raises(DatasetInvalid, match=r"episode 0 of .*400, 800; one gain above 0"):
        nas.evaluate(MODEL, dataset, plain_fit=False)


def test_the_sign_of_commands_is_judged_where_the_torque_is_on():
    rng = np.random.default_rng(0)
    commands = np.cumsum(rng.normal(0, 0.02, (3, STEPS, 1)), axis=1)
    positions = commands.copy()
    positions[:, ON:] = positions[:, [ON]] - 3 * (commands[:, ON:] - commands[:, [ON]])  # falls otherwise than told
    dataset = Dataset.from_arrays(list(positions), list(commands), rate=50, joints=["a"])
    assert any(finding.check == "command_sign" for finding in audit_dataset(dataset))
    on = np.concatenate([np.arange(length) < ON for length in dataset.lengths])[:, None].astype(np.float32)
    known = dataset.with_column(TORQUE, Feature(("a",)), on)
    assert not any(finding.check == "command_sign" for finding in audit_dataset(known))


def test_a_constant_gain_is_a_register_of_the_model_in_a_report(tmp_path: Path):
    problem = Problem.of(record((200, 200)), MODEL, None)
    assert problem.as_given.registers.values == {"p_gain": {"pendulum": 200.0}}
    assert (problem.evidence.gains == 1).all()
    assert np.sqrt(problem.evidence.mean_squares(problem.as_given.predict(problem.evidence))).max() < SAME


def test_episodes_keep_their_numbers_in_a_report():
    problem = Problem.of(record((400, 400, 400, 400)).select([1, 3]), MODEL, None)
    train, held = (problem.number_episodes(task.evidence).tolist() for task in (problem.train, problem.held))
    assert sorted([*train, *held]) == [1, 3]


def test_a_gain_is_used_in_the_joints_whose_register_the_model_states():
    dataset = two_joints(np.ones((3, 40, 2)))
    gains = Feature(("a", "b"))
    known = dataset.with_column(P_GAIN_COLUMN, gains, np.tile([200.0, 300.0], (dataset.n_frames, 1)))
    registers = ServoRegisters.of(known)
    assert registers.values["p_gain"] == {"a": 200.0, "b": 300.0}
    rising = np.repeat([100.0, 200.0, 400.0], dataset.lengths)
    changing = dataset.with_column(P_GAIN_COLUMN, gains, np.stack([rising, np.full(len(rising), 300.0)], axis=1))
    assert ServoRegisters.of(changing).changing == ("p_gain",)
    groups = [(places, found.values["p_gain"]["a"]) for places, found in group_by_registers(changing, {})]
    assert groups == [([0], 100.0), ([1], 200.0), ([2], 400.0)]


def test_pairing_says_in_how_many_rows_servos_have_torque_that_the_robot_s_lacked():
    dataset = record((400, 400), on=ON)
    remarks = [make_pairs(dataset, PairingSource(model=MODEL, engine=engine)).remarks for engine in ENGINES]
    assert remarks[0] == ()
    assert f"{2 * (STEPS - ON)} rows without torque at some servo" in remarks[1][0]


def test_the_voltage_is_the_mean_of_the_recording_whatever_rows_are_simulated(tmp_path: Path):
    dataset = record((400, 400), on=ON)
    on = dataset.columns[TORQUE].copy()
    on[ON + 10 : ON + 30] = 1  # torque that comes back is not simulated, but measured
    volts = np.where(np.arange(len(on))[:, None] % STEPS < ON, 7.0, 8.0).astype(np.float32)
    dataset = replace(dataset, columns={**dataset.columns, TORQUE: on})
    dataset = dataset.with_column("nas.voltage", Feature(("voltage",), ("V",)), volts)
    assert ServoRegisters.of(dataset).values["supply_voltage"] == {"pendulum": 7.14}
    stated = '<numeric name="supply_voltage" data="7.14"/><numeric name="p_gain"'
    model = tmp_path / "model.xml"
    model.write_text(MODEL.read_text().replace('<numeric name="p_gain"', stated))
    assert not any("supply_voltage" in note for note in nas.evaluate(model, dataset, plain_fit=False).notes)


def test_a_film_of_an_arm_without_torque_shows_all_and_of_others_says_what_it_shows():
    limp = record((400,), on=0)
    assert len(follow(limp, 0, [str(MODEL)]).ghosts[1].states) == STEPS + 1
    late = record((400,))
    on = late.columns[TORQUE].copy()
    on[:40] = 0
    late = replace(late, columns={**late.columns, TORQUE: on})
    assert len(follow(late, 0, [str(MODEL)]).ghosts[1].states) == STEPS - 40 + 1


def test_earlier_pairs_are_compared_with_their_source_where_the_torque_is_on():
    dataset = record((400, 400), on=ON)
    paired = nas.pair(dataset.without_columns([TORQUE]), MODEL)
    earlier = paired.with_column(TORQUE, dataset.features[TORQUE], dataset.columns[TORQUE])
    check_source(earlier, MujocoSimulator.load(MODEL, PERIOD, threads=1))
    with pytest.raises(JointMismatch, match="paired with another one"):
        check_source(earlier, MujocoSimulator.load("pendulum", PERIOD, threads=1))
