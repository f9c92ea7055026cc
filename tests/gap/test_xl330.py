"""Gains that differ by episode and servos that are switched off, on a simulated pendulum and on the recorded XL330."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.import_samples import REALDATA

from nas_data.cli import main
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import Feature
from nas_data.dataset.position_gains import P_GAIN_COLUMN
from nas_data.dataset.torque_off import TORQUE, find_run_and_fall, keep_torque_on_and_fall
from nas_data.effects.base import add_effects, parse, read_effects
from nas_data.errors import DatasetInvalid, ModelFileError
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.gains import with_relative_gains
from nas_data.gap.nominal import Nominal
from nas_data.gap.problem import Problem
from nas_data.gap.windows import cut_window
from nas_data.simulators.mujoco import SERVO_GROUP, MujocoSimulator

RESULTS = Path(__file__).parents[2] / "docs/results"
MODEL = RESULTS / "xl330.xml"
PERIOD, STEPS = 0.005, 160
EFFECTS = {
    "plain": (),
    "coulomb": ("coulomb_friction:joint=pendulum,torque=0.01",),
    "stribeck": ("stribeck_friction:joint=pendulum,torque=0.03,kinetic_ratio=0.4,stribeck_velocity=0.3",),
    "delay": ("command_delay:delay=0.02",),
    "slewing": ("speed_limit:joint=pendulum,speed=2",),
    "play": ("backlash:joint=pendulum,half_width=0.02",),
    "hooked": ("load_friction:joint=pendulum,ratio=0.2",),
}


def evidence(count: int = 3) -> EpisodeBatch:
    """Episodes that lift the pendulum, nothing measured yet."""
    lift = np.minimum(np.arange(STEPS) / 40, 1.0)
    commands = (np.linspace(0.4, 1.2, count)[:, None] * lift)[..., None]
    counts = np.ones(commands.shape[:2], bool)
    return EpisodeBatch(
        ("pendulum",), PERIOD, np.zeros((count, 1)), commands, np.zeros_like(commands), counts, np.arange(count)
    )


def swung(effects: tuple[str, ...]) -> MujocoSimulator:
    return MujocoSimulator.load(MODEL, PERIOD, effects=[parse(text) for text in effects], threads=1)


def recorded(registers: list[float], on: int = STEPS, width: int = 1) -> Dataset:
    """Episodes of the frictionless pendulum, with the gains of a recording beside them."""
    seen = evidence(len(registers))
    states = swung(()).rollout(seen.initial, seen.commands)
    before = np.concatenate([seen.initial[:, None], states[:, :-1]], axis=1)
    names = ("pendulum.pos", "pendulum.vel")
    features = {
        "observation.state": Feature(names),
        "action": Feature(names[:1]),
        "next.observation.state": Feature(names),
        P_GAIN_COLUMN: Feature(tuple(f"p_gain{i}" for i in range(width))),
        TORQUE: Feature(("torque_enable",)),
    }
    powered = np.tile(np.arange(STEPS) < on, len(registers))[:, None].astype(float)
    columns = {
        "observation.state": before.reshape(-1, 2),
        "action": seen.commands.reshape(-1, 1),
        "next.observation.state": states.reshape(-1, 2),
        P_GAIN_COLUMN: np.repeat(registers, STEPS)[:, None].repeat(width, axis=1).astype(float),
        TORQUE: powered,
    }
    return Dataset(features, columns, np.full(len(registers), STEPS), 1 / PERIOD)


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_where_all_is_driven_nothing_changes(effects: tuple[str, ...]):
    seen, simulator = evidence(), swung(effects)
    plain = simulator.rollout(seen.initial, seen.commands, seen.initial_loads)
    for driven in (np.full(3, STEPS), np.full(3, STEPS + 7)):
        assert np.array_equal(simulator.rollout(seen.initial, seen.commands, seen.initial_loads, driven), plain)


@pytest.mark.parametrize("effects", [e for name, e in EFFECTS.items() if name != "hooked"], ids=list(EFFECTS)[:-1])
def test_a_released_pendulum_falls_as_in_a_plain_loop(effects: tuple[str, ...]):
    seen, simulator, driven = evidence(), swung(effects), np.array([60, 0, STEPS])
    fallen = simulator.rollout(seen.initial, seen.commands, torque_off_from=driven)
    for episode in range(3):
        expected = plain_loop(simulator, seen.commands[episode], int(driven[episode]))
        assert np.abs(fallen[episode, :, 0] - expected).max() < 1e-6
    assert np.ptp(fallen[0, 60:, 0]) > 0.3


def plain_loop(simulator: MujocoSimulator, commands: np.ndarray, driven: int) -> np.ndarray:
    """Return positions [rad] (T,) of one simulation whose servo is disabled after some rows."""
    model = simulator.compiled.model
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, simulator.rest(np.zeros((1, 2)))[0], int(mujoco.mjtState.mjSTATE_FULLPHYSICS))
    own, positions = model.actuator_group.copy(), []
    for row, command in enumerate(commands):
        data.ctrl[simulator.layout.control] = command
        model.actuator_group[0] = 7 if row >= driven else own[0]
        model.opt.disableactuator = 1 << 7 if row >= driven else 0
        for _ in range(simulator.substeps):
            mujoco.mj_step(model, data)
        positions.append(float(simulator.layout.measure(data.qpos, data.qvel)[0]))
    model.actuator_group[:], model.opt.disableactuator = own, 0
    return np.array(positions)


def test_a_released_joint_rubs_by_its_load():
    """Friction under load, against a plain loop that sets it by hand: half as much as a servo that holds would have."""
    ratio, seen, driven = 0.4, evidence(), np.array([60, 0, 90])
    hooked = swung((f"load_friction:joint=pendulum,ratio={ratio}",))
    fallen = hooked.rollout(seen.initial, seen.commands, torque_off_from=driven)
    powered = hooked.rollout(seen.initial, seen.commands)
    assert np.array_equal(fallen[0, :60], powered[0, :60])
    assert np.array_equal(fallen[2, :90], powered[2, :90])
    assert np.abs(fallen[1]).max() == 0
    model, state = hooked.unpowered, fallen[0, 61]
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = state
    mujoco.mj_forward(model, data)
    data.qacc_warmstart[:] = 0
    for row in range(62, fallen.shape[1]):
        for _ in range(hooked.substeps):
            model.dof_frictionloss[:] = 0.5 * ratio * np.abs(data.qfrc_bias)
            mujoco.mj_step(model, data)
        assert data.qpos[0] == pytest.approx(fallen[0, row, 0], abs=2e-4)
    free = swung(()).rollout(state[None], seen.commands[:1, 62:], torque_off_from=np.zeros(1, int))
    assert np.abs(free[0, :, 0] - fallen[0, 62:, 0]).max() > 0.02


def test_switching_off_leaves_the_simulator_as_it_was():
    simulator = swung(())
    assert (simulator.unpowered.actuator_group == SERVO_GROUP).all()
    assert (simulator.model.actuator_group == 0).all()
    assert simulator.model.opt.disableactuator == 0


@pytest.mark.parametrize("effects", ["", "servo_stiffness:joint=pendulum,factor=0.7"])
def test_every_episode_is_simulated_at_its_own_gain(effects: str, tmp_path: Path):
    seen = replace(evidence(), gains=np.array([[1.0], [2.0], [0.25]]))
    hidden = [parse(effects)] if effects else []
    found = Nominal.load(MODEL, seen).predict(seen, hidden)
    for episode, gain in enumerate((1.0, 2.0, 0.25)):
        path = tmp_path / f"{episode}.xml"
        path.write_text(MODEL.read_text().replace('kp="0.57780"', f'kp="{0.57780 * gain}"'))
        alone = seen.select([episode])
        expected = Nominal.load(path, alone).predict(replace(alone, gains=np.ones((1, 1))), hidden)
        assert np.abs(found[episode] - expected[0]).max() < 1e-9


def test_every_row_is_stepped_at_its_episode_s_gain():
    gains = np.array([[1.0], [2.0], [0.25]])
    seen = replace(evidence(), gains=gains)
    nominal = Nominal.load(MODEL, seen)
    states = np.random.default_rng(0).normal(0, 0.3, (*seen.measured.shape[:2], 2))
    stepped = nominal.step(seen, states)
    for episode, gain in enumerate(gains):
        alone = nominal.with_gains(gain).simulator().predict(states[episode], seen.commands[episode])
        assert np.array_equal(stepped[episode, :, 0], alone[:, 0])
    assert not np.allclose(stepped, nominal.step(replace(seen, gains=np.ones((3, 1))), states))


def test_gains_are_those_of_the_recording_over_the_model_s():
    told = EpisodeBatch.of(with_relative_gains(recorded([100, 400, 800]), MODEL, "data"))
    assert told.gains.tolist() == [[0.25], [1.0], [2.0]]
    assert told.select([2, 0]).gains.tolist() == [[2.0], [0.25]]


def test_gains_that_differ_need_a_model_that_says_where_its_own_holds(tmp_path: Path):
    silent = tmp_path / "silent.xml"
    silent.write_text(MODEL.read_text().replace('name="p_gain"', 'name="other"'))
    with pytest.raises(ModelFileError, match=r"data was .* gains .*100, 400.*silent\.xml .*<numeric name=\"p_gain\""):
        with_relative_gains(recorded([100, 400]), silent, "data")
    alike = recorded([100, 100])
    assert with_relative_gains(alike, silent, "data") is alike
    assert (EpisodeBatch.of(alike).gains == 1).all()


@pytest.mark.parametrize("value", [0, -3, np.nan, np.inf])
def test_what_is_no_gain_is_refused(value: float, tmp_path: Path):
    with pytest.raises(DatasetInvalid, match="one gain above 0"):
        with_relative_gains(recorded([400, value]), MODEL, "data")
    odd = tmp_path / "odd.xml"
    odd.write_text(MODEL.read_text().replace('data="400"', 'data="0"'))
    with pytest.raises(ModelFileError, match="above 0"):
        with_relative_gains(recorded([400, 800]), odd, "data")


def test_a_gain_that_changes_within_an_episode_is_refused():
    dataset = recorded([400, 400])
    gains = dataset.columns[P_GAIN_COLUMN].copy()
    gains[20:] = 800
    dataset = replace(dataset, columns={**dataset.columns, P_GAIN_COLUMN: gains})
    with pytest.raises(DatasetInvalid, match="episode 0 of data is 400, 800"):
        with_relative_gains(dataset, MODEL, "data")
    with pytest.raises(DatasetInvalid, match="2 columns"):
        with_relative_gains(recorded([400, 400], width=2), MODEL, "data")


def test_evidence_goes_on_where_the_torque_is_off():
    found = EpisodeBatch.of(recorded([400, 400], on=60))
    assert found.torque_off_from.tolist() == [60, 60]
    assert found.commands.shape[1] == STEPS
    assert cut_window(found, 0, 50, 40).torque_off_from.tolist() == [10]
    assert cut_window(found, 1, 70, 40).torque_off_from.tolist() == [0]
    assert EpisodeBatch.of(recorded([400, 400])).torque_off_from.tolist() == [STEPS, STEPS]


@given(on=st.lists(st.booleans(), min_size=1, max_size=30))
@settings(max_examples=60, deadline=None)
def test_an_episode_is_kept_from_its_longest_drive_to_the_next(on: list[bool]):
    powered = np.array(on)
    rows = np.flatnonzero(find_run_and_fall(powered, ~powered))
    assert bool(len(rows)) == powered.any()
    if len(rows):
        count = int(np.append(powered[rows], False).argmin())
        runs = "".join("x" if value else " " for value in on).split()
        assert count == max(map(len, runs))
        assert np.array_equal(rows, np.arange(rows[0], rows[-1] + 1))
        assert not powered[rows[count:]].any()
        assert rows[-1] + 1 == len(on) or powered[rows[-1] + 1]


def test_a_dataset_that_is_always_driven_is_not_cut():
    dataset = recorded([400, 400])
    assert keep_torque_on_and_fall(dataset) is dataset


@pytest.fixture(scope="module")
def dropped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the imported lift_and_drop logs."""
    logs = [REALDATA / "bam_xl330" / f"2026-01-15_10h{time}.json" for time in ("28m17", "28m49", "29m21", "29m54")]
    if not all(log.is_file() for log in logs):
        pytest.skip("the real recordings are not in ../shared/realdata")
    folder = tmp_path_factory.mktemp("xl330")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["import", *map(str, logs), "--map", "xl330_json", "--name", "dropped"]) == 0
    return folder / "datasets/dropped"


def test_the_recorded_fall_is_what_the_authors_friction_explains(dropped: Path):
    problem = Problem.load(dropped, MODEL)
    seen = problem.evidence
    assert seen.gains.ravel().tolist() == [0.25, 0.5, 1.0, 2.0]
    assert ((seen.torque_off_from > 390) & (seen.torque_off_from < 410)).all()
    nominal = problem.train.nominal
    stock, authors = (
        np.degrees(np.sqrt(seen.mean_squares(nominal.predict(seen, effects))[:, 0]))
        for effects in ((), read_effects(RESULTS / "xl330_authors.json"))
    )
    assert ((stock > 10) & (stock < 36)).all()  # without friction 12 to 35°, with it 1.4 to 4.6°, as published
    assert ((authors > 1.2) & (authors < 5)).all()


def test_the_refusal_reaches_the_user(dropped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["gap", str(dropped), "--model", "pendulum", "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "100, 200, 400, 800" in told
    assert 'name="p_gain"' in told
    assert not (tmp_path / "out").exists()


def test_what_is_written_keeps_the_model_s_register(tmp_path: Path):
    nominal = Nominal.load(MODEL, evidence())
    spec = nominal.make_spec({"pendulum.gain": 1.1})
    add_effects(spec, [parse(EFFECTS["coulomb"][0])])
    assert 'name="p_gain"' in spec.to_xml()
    assert json.loads((RESULTS / "xl330_authors.json").read_text())[0]["effect"] == "coulomb_friction"
