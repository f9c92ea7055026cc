"""Machines under commanded torques: episodes cut from motions under way, true to MuJoCo on every plant."""

from functools import cache
from itertools import product

import mujoco
import numpy as np
import pytest
from support.blind_samples import (
    INDEPENDENT,
    answered,
    entry_of,
    followed,
    know_everything,
    know_nothing,
    report_of,
    shorten,
)

from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.benchmark import BlindPlan, run
from nas_data.benchmarks.blind.case import Base, CommandSequence, Hidden, Identity, Truth, find_equivalents
from nas_data.benchmarks.blind.draw import draw_case
from nas_data.benchmarks.blind.grade import ConfidenceGrade, grade_names
from nas_data.benchmarks.blind.machines import find_reach
from nas_data.benchmarks.blind.plants.base import find_plant, make_chain
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.hiding import PlantBody, stack_arms
from nas_data.benchmarks.blind.settings.base import find_setting
from nas_data.benchmarks.blind.write import DATASET, FRESH, write_case
from nas_data.dataset.read import read
from nas_data.dataset.transitions import estimate_velocities
from nas_data.dataset.verify import verify

TORQUE = find_setting("torque")
FINE = 2e-5  # [s] timestep of the reference, which runs ahead by half of it
MACHINES = [1, 6, 11]  # numbers of drawn machines: hinges and slides of three joints, with friction and without
SOME = [MACHINES[0], *(pytest.param(number, marks=pytest.mark.slow) for number in MACHINES[1:])]


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    shorten(monkeypatch)


def play(plant: str, arm: NominalArm, truths: list[Truth], tape: CommandSequence, period: float) -> np.ndarray:
    """Return states (len(truths), E, T + 1, 2n) of a tape."""
    return find_plant(plant)(arm, truths, tape.commands, tape.poses, period, 0.0, tape.start_speeds)


@cache
def reference(number: int, episodes: int) -> np.ndarray:
    """Return positions (episodes, T + 1, n) of a nominal machine in MuJoCo at a fine timestep."""
    arm, conditions, tape = followed(number)
    spec, period, tape = arm.spec(), conditions.period, tape[:episodes]
    spec.option.timestep = FINE
    for joint in spec.joints:
        joint.solref_friction = [2 * FINE, 1]
    model, shown = spec.compile(), []
    for commands, pose, speeds in zip(tape.commands, tape.poses, tape.start_speeds, strict=True):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = pose, speeds
        rows = [data.qpos.copy()]
        for command in commands:
            data.ctrl[:] = command
            mujoco.mj_step(model, data, round(period / FINE))
            rows.append(data.qpos.copy())
        shown.append(rows)
    return np.array(shown)


def test_machines_differ_in_all_that_users_differ_in():
    many = [TORQUE.draw(Identity("none", "numpy", number, 5, setting="torque")) for number in range(40)]
    assert {len(arm.joints) for arm, _ in many} == {1, 2, 3}
    constants = [Constants.of(arm.model()) for arm, _ in many]
    assert {bool(slides) for numbers in constants for slides in numbers.sliding} == {True, False}
    assert {bool(numbers.friction.any()) for numbers in constants} == {True, False}
    assert {conditions.rate for _, conditions in many} == {200, 250, 500, 1000}
    assert {conditions.sensor.speed_noise is None for _, conditions in many} == {True, False}
    for arm, conditions in many:
        steps = conditions.period / arm.model().opt.timestep
        assert steps == pytest.approx(round(steps)) and conditions.episodes % conditions.pieces == 0


@pytest.mark.parametrize("number", MACHINES)
def test_rigid_body_dynamics_with_slides_equal_mujocos(number):
    arm, _ = TORQUE.draw(Identity("none", "numpy", number, 5, setting="torque"))
    model, rng, n = arm.model(), np.random.default_rng(0), len(arm.joints)
    chain = make_chain(stack_arms([PlantBody.of(Constants.of(model), Base.nominal(n))], 4))
    q, v = rng.uniform(-1.5, 1.5, (4, n)), rng.uniform(-5, 5, (4, n))
    mass, bias = chain.dynamics(q, v)
    for row in range(4):
        data, full = mujoco.MjData(model), np.zeros((n, n))
        data.qpos[:], data.qvel[:] = q[row], v[row]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        np.testing.assert_allclose(mass[row] + np.diag(model.dof_armature), full, atol=1e-12)
        np.testing.assert_allclose(bias[row], data.qfrc_bias, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("plant", INDEPENDENT)
@pytest.mark.parametrize("number", MACHINES)
def test_without_effects_a_plant_follows_mujoco_within_the_noise(plant, number):
    arm, conditions, tape = followed(number)
    n, few = len(arm.joints), tape[:1]
    played = play(plant, arm, [Truth(Base.nominal(n))], few, conditions.period)[0]
    true = reference(number, len(few.poses))
    assert np.abs(played[:, 0] - np.concatenate([few.poses, few.start_speeds], axis=1)).max() < 1e-12
    assert np.sqrt(np.square(played[..., :n] - true).mean(axis=(0, 1))).max() < conditions.sensor.noise
    speeds = np.gradient(true, conditions.period, axis=1)[:, 1:-1]
    error = np.sqrt(np.square(played[:, 1:-1, n:] - speeds).mean())
    assert error < 0.1 * np.sqrt(np.square(speeds).mean())


@pytest.mark.parametrize("plant", INDEPENDENT)
@pytest.mark.parametrize("number", SOME)
def test_the_model_handed_over_follows_its_plant_up_to_its_timestep(plant, number):
    arm, conditions, tape = followed(number)
    n, truths = len(arm.joints), [Truth(Base.nominal(len(arm.joints)))]
    if (plant, number) == ("numpy", MACHINES[0]):
        one, other = (with_each_effect(name)[None] for name in (plant, "mujoco"))
    else:
        one, other = (play(name, arm, truths, tape, conditions.period)[0] for name in (plant, "mujoco"))
    ahead = arm.model().opt.timestep * np.sqrt(np.square(one[..., n:]).mean(axis=(0, 1)))
    assert (np.sqrt(np.square(one - other)[..., :n].mean(axis=(0, 1))) < conditions.sensor.noise + ahead).all()


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=[pytest.mark.bullet, pytest.mark.slow])])
@pytest.mark.parametrize("effect", TORQUE.inside)
def test_an_effect_does_to_a_plant_what_ours_does_to_the_model(plant, effect):
    """The change that each hidden effect makes, in a joint that turns and in one that slides."""
    arm, conditions, _ = followed(MACHINES[0])
    own, native = (with_each_effect(name) for name in (plant, "mujoco"))
    for row in (0, 1):
        one, other = (states[effect, row] - states[None] for states in (own, native))
        one, other = (change[:2, :, : len(arm.joints)] for change in (one, other))
        moved = np.sqrt(np.square(one).mean())
        assert moved > conditions.sensor.floor
        assert np.sqrt(np.square(one - other).mean()) < 0.1 * moved


@cache
def with_each_effect(plant: str) -> dict[tuple[str, int] | None, np.ndarray]:
    """Return states (E, T + 1, 2n) with each effect, in the first joint and in the second, and without."""
    arm, conditions, tape = followed(MACHINES[0])
    n, constants, hidden = len(arm.joints), Constants.of(arm.model()), {}
    for (name, kind), row in product(TORQUE.inside.items(), (0, 1)):
        values = kind.draw(np.random.default_rng(row), constants, row, False)
        hidden[name, row] = Hidden(name, arm.joints[row] if kind.per_joint else None, values)
    truths = [Truth(Base.nominal(n)), *(Truth(Base.nominal(n), (one,)) for one in hidden.values())]
    return dict(zip((None, *hidden), play(plant, arm, truths, tape, conditions.period), strict=True))


@pytest.mark.parametrize(
    "plant",
    [
        "mujoco",
        pytest.param("numpy", marks=pytest.mark.slow),
        pytest.param("bullet", marks=[pytest.mark.bullet, pytest.mark.slow]),
    ],
)
def test_motions_stay_in_range_and_torques_within_their_limits(plant):
    case = draw_case("two", plant, 2, 3, setting="torque")
    constants = Constants.of(case.arm.model())
    assert (np.abs(case.recorded.commands) <= constants.control[:, 1] * (1 + 1e-6)).all()
    assert (np.abs(case.recorded.positions) < 3 * find_reach(constants.sliding)[:, 1]).all()
    assert all(mark >= TORQUE.least for mark in case.marks)


def test_pieces_go_on_where_the_one_before_ended_and_fresh_ones_begin_in_motion(tmp_path):
    case = draw_case("none", "mujoco", 0, 3, setting="torque")
    pieces, positions = case.conditions.pieces, case.recorded.positions
    for number in range(len(positions) - 1):
        apart = np.abs(positions[number + 1, 0] - positions[number, -1]).max()
        assert (apart < 1e-4) == bool((number + 1) % pieces)
    write_case(case, tmp_path)
    with np.load(tmp_path / FRESH) as fresh:
        n = len(case.arm.joints)
        np.testing.assert_array_equal(fresh["starts"][:, :n], fresh["positions"][:, 0])
        assert (np.abs(fresh["starts"][:, n:]).max(axis=0) > 0.01).all()
    again = draw_case("none", "mujoco", 0, 3, setting="torque")
    assert again.answer() == case.answer()
    np.testing.assert_array_equal(again.recorded.readings, case.recorded.readings)


def test_a_dataset_has_torques_and_speeds_measured_or_estimated(tmp_path):
    sorts = {}
    for number in range(12):
        _, conditions = TORQUE.draw(Identity("none", "mujoco", number, 3, setting="torque"))
        sorts.setdefault(conditions.sensor.speed_noise is None, number)
    estimated = set()
    for number in sorts.values():
        case = draw_case("none", "mujoco", number, 3, setting="torque")
        write_case(case, tmp_path / str(number))
        assert verify(tmp_path / str(number) / DATASET) == []
        dataset, n = read(tmp_path / str(number) / DATASET), len(case.arm.joints)
        assert set(dataset.kinds) == {".effort"} and dataset.joints == case.arm.joints
        rows = dataset.episode(1)
        ours = estimate_velocities(case.recorded.readings[1], dataset.fps)[:-1]
        estimated.add(np.allclose(dataset.states[rows, n:], ours, atol=1e-3))
        assert (case.recorded.speeds is None) == np.allclose(dataset.states[rows, n:], ours, atol=1e-3)
    assert estimated == {True, False}


@pytest.mark.parametrize(
    "plant",
    [
        pytest.param("numpy", marks=pytest.mark.slow),
        pytest.param("bullet", marks=[pytest.mark.bullet, pytest.mark.slow]),
        pytest.param("mujoco", marks=pytest.mark.slow),
    ],
)
def test_who_knows_everything_is_right_about_machines_too(plant, tmp_path):
    plan = BlindPlan(("two",), (plant,), 1, 4, setting="torque")
    for record in run(plan, tmp_path, know_everything, lambda line: None):
        grade, fresh = record.outcome.grade, record.outcome.fresh
        assert grade.exact and grade.verdict_right, record
        assert fresh.after < fresh.floor + 0.05 * fresh.before, record
        assert fresh.least == pytest.approx(fresh.after, rel=0.2)


@pytest.mark.bullet
@pytest.mark.slow
def test_something_outside_the_catalogue_hides_there_too(tmp_path):
    plan = BlindPlan(("outside",), ("numpy", "bullet"), 1, 4, setting="torque")
    for record in run(plan, tmp_path, know_nothing, lambda line: None):
        assert record.outcome.grade.marks[0] >= TORQUE.least


def test_one_inertia_with_two_names_may_have_either():
    model = '<mujoco><option gravity="0 0 {}"/><worldbody><body><joint name="x" type="slide" axis="0 0 1"/>' \
            '<geom size="0.1" mass="1"/></body></worldbody><actuator><motor joint="x" forcerange="-9 9"/></actuator>' \
            "</mujoco>"  # fmt: skip
    hidden = Hidden("rotor_inertia", "x", {"inertia": 0.4})
    names = []
    for gravity in (0, -9.81):
        constants = Constants.of(mujoco.MjModel.from_xml_string(model.format(gravity)))
        names.append(find_equivalents(constants, hidden))
    assert names == [(("payload", None),), None]
    entry = {**vars(hidden), "equals": names[0]}
    answer = answered([entry], joints=["x"])
    report = report_of([entry_of("payload", None, {"mass": 0.4})], "explained")
    found = grade_names(answer, report)
    assert found.exact and found.confidences == (ConfidenceGrade(0.95, True),)
    assert not grade_names(answered([{**entry, "equals": []}], joints=["x"]), report).exact
