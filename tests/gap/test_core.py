"""The parts of the search: evidence, floor, base parameters, start states, fits."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.evidence_samples import JOINTS, QUANTUM, commanded, measured
from support.typical_effects import typical

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.noise import estimate_noise, find_quantisation_step, median
from nas_data.dataset.read import read
from nas_data.dataset.versions import resolve
from nas_data.effects.base import parse
from nas_data.envs.base import find_task
from nas_data.errors import DatasetInvalid
from nas_data.gap.compose import find_stability
from nas_data.gap.episode_batch import EpisodeBatch, split_episodes
from nas_data.gap.floor import estimate_noise_floor, measure_step_errors
from nas_data.gap.nominal import Nominal, find_fine_timestep
from nas_data.gap.nominal_parameters import list_base_parameters
from nas_data.gap.search.final import list_parameters
from nas_data.gap.search.fit import fit, solve_bounded
from nas_data.gap.search.objective import FitTask
from nas_data.gap.search.parameters import FreeParameters
from nas_data.gap.verdict import decide_verdict
from nas_data.gap.windows import cut_windows
from nas_data.gap.write_model import write_model
from nas_data.mjcf.bake_inertia import bake_inertia
from nas_data.recorders.recipe import Recipe
from nas_data.robots.base import find_robot
from nas_data.simulators.initial_states import InitialLoad
from nas_data.simulators.mujoco import MujocoSimulator

SAMPLE = Path(__file__).parents[2] / "datasets" / "ergojr_sample"


@given(step=st.floats(1e-3, 2e-2), seed=st.integers(0, 100))
@settings(max_examples=25, deadline=None)
def test_quantum_of_rounded_readings_is_found(step: float, seed: int):
    readings = np.round(np.random.default_rng(seed).uniform(-1, 1, 3000) / step) * step
    assert find_quantisation_step(readings.astype(np.float32).astype(float)) == pytest.approx(step, rel=1e-3)


def test_unrounded_readings_have_no_quantum():
    assert find_quantisation_step(np.random.default_rng(0).uniform(-1, 1, 3000)) == 0


def test_floor_is_that_of_quantum_and_noise():
    _, evidence = measured()
    expected = np.hypot(QUANTUM / np.sqrt(12), np.radians(0.05))
    assert np.all(np.abs(estimate_noise_floor(evidence) / expected - 1) < 0.2)


@given(noise=st.floats(0.05, 6.0), period=st.sampled_from([0.005, 0.01, 0.02]), seed=st.integers(0, 100))
@example(noise=0.4, period=0.02, seed=16)  # few readings repeat the one before: they alone would show no quantum
@settings(max_examples=40, deadline=None)
def test_floor_of_a_moving_joint_is_that_of_quantum_and_noise(noise: float, period: float, seed: int):
    """Whatever the noise is in quanta; sweeps of up to 2 Hz add nothing to it.

    The bounds are those of chance: in 2250 draws, joints were within 0.82 and 1.23, the medians 0.92 and 1.17.
    """
    rng = np.random.default_rng(seed)
    steps = round(3 / period)
    times = np.arange(steps)[None, :, None] * period
    waves = [
        rng.uniform(0.2, 0.6) * np.sin(2 * np.pi * rng.uniform(0.2, 2, (8, 1, 6)) * times + 6 * rng.random())
        for _ in "ab"
    ]
    positions = sum(waves)
    readings = np.round((positions + noise * QUANTUM * rng.standard_normal(positions.shape)) / QUANTUM) * QUANTUM
    counts = np.ones(positions.shape[:2], bool)
    evidence = EpisodeBatch(JOINTS, period, readings[:, 0], positions, readings, counts, np.arange(8))
    expected = QUANTUM * np.hypot(1 / np.sqrt(12), noise)
    ratio = estimate_noise_floor(evidence) / expected
    assert np.all((ratio > 0.75) & (ratio < 1.3)), ratio
    assert 0.88 < np.median(ratio) < 1.22, ratio


@given(noise=st.floats(0.05, 3.0), seed=st.integers(0, 100))
@example(noise=0.4, seed=0)  # the plain median of third differences is one quantum, a third too little
@settings(max_examples=40, deadline=None)
def test_a_floor_grows_smoothly_with_the_noise(noise: float, seed: int):
    rng = np.random.default_rng(seed)
    slow = np.sin(np.linspace(0, 20, 3000)) * 0.3
    white = rng.standard_normal(3000)
    sizes = [
        estimate_noise([np.round((slow + share * noise * QUANTUM * white) / QUANTUM) * QUANTUM], 3, QUANTUM)
        for share in (1, 1.02)
    ]
    assert abs(sizes[1] / sizes[0] - 1) < 0.1


@pytest.mark.parametrize("noise", [0.1, 0.3, 0.4, 0.6, 1.0])
def test_noise_of_a_joint_that_stands_still_is_not_taken_for_more(noise: float):
    """Rounding hides some of it; stretches that were chosen by their noise would show up to twice as much."""
    rng = np.random.default_rng(0)
    poses = rng.uniform(-1, 1, (20, 1)) + noise * rng.standard_normal((20, 300))
    readings = list(np.round(poses) * QUANTUM)
    assert 0 <= estimate_noise(readings, 3, QUANTUM) < 1.1 * QUANTUM * np.hypot(1 / np.sqrt(12), noise)


def test_episodes_too_short_for_differences_say_nothing_of_noise():
    assert (
        estimate_noise([np.arange(4) * QUANTUM] * 3, 5, QUANTUM)
        == estimate_noise([np.arange(4) * 0.1] * 3, 5)
        == np.inf
    )


@pytest.mark.parametrize(
    ("sizes", "step", "expected"),
    [
        ([0, 0, 0, 1], 1.0, 1 / 3),
        ([0, 1, 1, 2], 1.0, 1.0),
        ([3.0, 3.0, 3.0], 1.0, 3.0),
        ([0.2, 0.5, 0.9], 0.0, 0.5),
    ],
)
def test_a_median_of_steps_lies_within_a_step(sizes: list[float], step: float, expected: float):
    assert median(np.array(sizes), step) == pytest.approx(expected)


@pytest.fixture(scope="module")
def thrown():
    """Clean recordings of an arm with play, driven by new torques every 50 or 100 ms."""
    recipe = Recipe(environment="Striker", dynamics="backlash", episodes=16, steps=60, holds=(1, 2))
    return recipe.record()[0], find_task("Striker").simulator("source")


def with_noise(dataset: Dataset, deviation: float) -> Dataset:
    """Return transitions whose position readings have normal noise [rad], velocities left alone."""
    n, rng = len(dataset.joints), np.random.default_rng(0)
    columns = dict(dataset.columns)
    for key in ("observation.state", "next.observation.state"):
        columns[key] = columns[key].copy()
        columns[key][:, :n] += rng.normal(0, deviation, (dataset.n_frames, n))
    return replace(dataset, columns=columns)


def test_fast_motion_without_noise_is_not_taken_for_noise(thrown):
    """Its differences look like noise of any order; the source's errors after one step tell."""
    dataset, source = thrown
    evidence, fast = EpisodeBatch.of(dataset), [2, 4, 6]  # light ones that have no play
    assert estimate_noise_floor(evidence)[fast].min() > np.radians(0.2)
    assert estimate_noise_floor(evidence, measure_step_errors(dataset, source))[fast].max() < np.radians(0.1)


@pytest.mark.parametrize("degrees", [0.3, 1.0, 3.0])
def test_noise_is_not_taken_for_errors_of_the_model(thrown, degrees: float):
    dataset, source = thrown
    noise = np.radians(degrees)
    noisy = with_noise(dataset, noise)
    assert measure_step_errors(noisy, source).min() > 0.95 * noise
    assert estimate_noise_floor(EpisodeBatch.of(noisy), measure_step_errors(noisy, source)).min() > 0.85 * noise


@pytest.mark.parametrize("count", [2, 3, 10, 20])
def test_every_episode_is_fitted_or_held_out(count: int):
    train, held = split_episodes(commanded(count))
    assert sorted([*train.numbers, *held.numbers]) == list(range(count))
    assert len(held) >= 1


def test_windows_are_stretches_of_the_recording():
    evidence = commanded(2, seconds=20)
    evidence = EpisodeBatch(
        JOINTS, 0.01, evidence.initial_positions, evidence.commands, evidence.commands, evidence.mask, np.arange(2)
    )
    cut = cut_windows(evidence, 2400)
    assert cut.commands.shape == (4, 500, 6)
    for row, number in enumerate(cut.numbers):
        whole = evidence.commands[number]
        assert any(np.array_equal(whole[k : k + 500], cut.commands[row]) for k in range(len(whole) - 499))


def test_short_episodes_are_no_evidence():
    short = read(resolve(SAMPLE)).select([0])
    rows = {key: column[:5] for key, column in short.columns.items()}
    with pytest.raises(DatasetInvalid, match="record episodes"):
        EpisodeBatch.of(replace(short, columns=rows, lengths=np.array([5])))


def test_writing_out_inertias_changes_nothing():
    evidence = commanded()
    nominal = Nominal.load("ergojr", evidence)
    plain = MujocoSimulator.load("ergojr", 0.01).rollout(evidence.initial, evidence.commands, evidence.initial_loads)
    assert np.array_equal(nominal.predict(evidence), plain[..., :6])


def test_each_base_parameter_moves_the_robot():
    evidence = commanded(2)
    nominal = Nominal.load("ergojr", evidence)
    before = nominal.predict(evidence)
    factors = {p.name: 0.2 if p.kind == "limit" else 1.2 for p in nominal.base}  # a limit counts where it is reached
    moved = {name: nominal.predict(evidence, (), {name: factor}) - before for name, factor in factors.items()}
    idle = [name for name, change in moved.items() if np.abs(change).max() < 1e-5]
    assert idle == ["m1.mass"]  # the first link turns about its own upright axis and carries nothing off it


def test_masses_of_welded_bodies_belong_to_the_joint_that_moves_them():
    spec = bake_inertia(find_robot("ergojr_penholder").spec())
    bodies = [body for p in list_base_parameters(spec, JOINTS) if p.kind == "mass" for body in p.bodies]
    model = spec.compile()
    moving = [model.body(i).name for i in range(1, model.nbody) if model.body_weldid[i] and model.body_mass[i] > 0]
    assert sorted(bodies) == sorted(moving)


@pytest.mark.parametrize(
    "effects", [(), ("backlash:joint=m3,half_width=0.03",), ("joint_compliance:joint=m2,stiffness=0.8",)]
)
def test_a_settled_arm_stays_where_it_is(effects: tuple[str, ...]):
    simulator = MujocoSimulator.load("ergojr", 0.01, effects=[parse(text) for text in effects])
    pose = np.array([0.2, 0.6, -0.4, 0.1, 0.5, -0.3])
    state = np.concatenate([pose, np.zeros(6)])[None]
    full = simulator.settled(state, np.full((1, 6), InitialLoad.GRAVITY))
    data = mujoco.MjData(simulator.model)
    mujoco.mj_setState(simulator.model, data, full[0], int(mujoco.mjtState.mjSTATE_FULLPHYSICS))
    assert np.allclose(simulator.layout.measure(data.qpos, data.qvel)[:6], pose, atol=1e-9)
    mujoco.mj_forward(simulator.model, data)
    held = pose + data.qfrc_bias[simulator.layout.dof] / 0.336
    moved = simulator.rollout(state, np.tile(held, (1, 50, 1)), np.full((1, 6), InitialLoad.GRAVITY))[0, :, :6]
    assert np.abs(moved - pose).max() < 2e-3


def test_the_minimum_within_bounds_is_the_minimum():
    rng = np.random.default_rng(0)
    for _ in range(50):
        rows = rng.normal(size=(8, 4))
        square, pull = rows.T @ rows, rng.normal(size=4)
        change = solve_bounded(square, pull, 0.0, np.full(4, -0.3), np.full(4, 0.3))
        slope = square @ change + pull
        inside = np.abs(change) < 0.3 - 1e-9
        assert np.abs(slope[inside]).max(initial=0) < 1e-6
        assert np.all(np.abs(change) <= 0.3 + 1e-12)


@pytest.mark.parametrize(
    ("truth", "start", "name"),
    [
        ("backlash:joint=m3,half_width=0.03", "backlash:joint=m3,half_width=0.012", "half_width"),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("command_delay:delay=0.04", "command_delay:delay=0.02", "delay"),
                ("joint_offset:joint=m5,offset=-0.05", "joint_offset:joint=m5,offset=0.01", "offset"),
                ("torque_limit:joint=m2,torque=0.08", "torque_limit:joint=m2,torque=0.13", "torque"),
            )
        ),
    ],
)
def test_a_fit_recovers_effect_and_base(truth: str, start: str, name: str):
    nominal, evidence = measured(truth, {"m2.mass": 1.08, "m3.damping": 0.93})
    task = FitTask(nominal, evidence, estimate_noise_floor(evidence))
    parameters = FreeParameters((parse(start),), nominal.base)
    found = fit(task, parameters, parameters.initial_theta(), steps=8)
    assert found is not None
    wanted = getattr(parse(truth), name)
    assert getattr(found.effects[0], name) == pytest.approx(wanted, rel=0.05)
    rest = np.sqrt(task.evidence.mean_squares(found.predicted).mean(0)) / task.floor
    assert rest.max() < 1.2


def test_the_written_model_says_in_plain_mujoco_what_was_fitted(tmp_path):
    evidence = commanded(2)
    nominal = Nominal.load("ergojr", evidence)
    effects, factors = (
        [parse("backlash:joint=m3,half_width=0.03"), parse("speed_limit:joint=m2,speed=3")],
        {"m4.gain": 0.9},
    )
    path, _ = write_model(tmp_path, nominal, effects, factors)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    assert model.opt.timestep == pytest.approx(find_fine_timestep(nominal))
    assert [model.actuator(i).name for i in range(6)] == list(JOINTS)
    assert [model.joint(i).name for i in range(model.njnt)][:3] == ["m1", "m2", "m3"]
    simulated = MujocoSimulator.load(path, 0.01).rollout(evidence.initial, evidence.commands)
    steps = round(0.01 / model.opt.timestep)
    for row in range(100):
        data.ctrl[:] = evidence.commands[0, row]
        mujoco.mj_step(model, data, steps)
        read = [float(data.sensor(f"{joint}.pos").data[0]) for joint in JOINTS] if row else None
    mujoco.mj_forward(model, data)
    read = [float(data.sensor(f"{joint}.pos").data[0]) for joint in JOINTS]
    assert np.allclose(read, simulated[0, 99, :6], atol=1e-6)


@pytest.mark.parametrize(
    ("before", "after", "effects", "expected"),
    [
        ([1.0, 1.1], [1.0, 1.0], 0, "none"),
        ([4.0, 1.1], [1.1, 1.0], 0, "retuned"),
        ([4.0, 1.1], [3.0, 1.0], 0, "unexplained"),
        ([4.0, 1.1], [1.1, 1.0], 1, "explained"),
        ([4.0, 9.0], [1.1, 5.0], 1, "partly_explained"),
    ],
)
def test_verdicts(before: list[float], after: list[float], effects: int, expected: str):
    assert decide_verdict(np.array(before), np.array(after), effects) == expected


def test_a_plain_fit_that_adds_effects_is_no_retuned_model():
    assert decide_verdict(np.array([4.0]), np.array([1.0]), named=0, unnamed=2) == "unexplained"


def test_a_change_of_more_than_25_percent_is_no_retuning():
    before, after = np.array([4.0]), np.array([1.0])
    assert decide_verdict(before, after, named=0, unnamed=1, changed=2) == "unexplained"
    assert decide_verdict(before, after, named=1, unnamed=1, changed=2) == "explained"


def test_a_model_in_which_nothing_changed_is_not_retuned():
    assert decide_verdict(np.array([1.4]), np.array([1.4]), named=0, changed=0) == "none"


def test_stability_is_unknown_where_a_named_joint_has_no_two_halves():
    named = SimpleNamespace(stable={"a": False}, findings=[SimpleNamespace(effect=typical("backlash", "b"))])
    assert [find_stability(named, joint) for joint in "abc"] == [False, None, True]


def test_a_parameter_without_an_interval_has_none():
    (entry,) = list_parameters(typical("viscous_friction"), {}, {}).values()
    assert entry["interval95"] is None
