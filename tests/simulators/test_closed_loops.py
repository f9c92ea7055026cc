"""A learned model in a closed loop: one that says nothing is the source, one that knows all is the target."""

import itertools

import numpy as np
import pytest
from support.linear_samples import LinearSimulator, knows, network, silent
from support.recording_samples import pendulum, wander
from support.simulator_samples import CONTACTS

from nas_data.effects.backlash import Backlash
from nas_data.errors import CheckpointError, JointMismatch
from nas_data.models.augmented import AugmentedStepper, ForwardStepper, LearnedStepper
from nas_data.simulators.mujoco import MujocoSimulator

KINDS = ("delta", "forward")


@pytest.mark.parametrize("what", ["plain", "backlash", "contacts"])
def test_a_network_that_says_nothing_leaves_the_source_as_it_is(tmp_path, what):
    (tmp_path / "contacts.xml").write_text(CONTACTS)
    effects = (Backlash(joint="m3", half_width=0.03),) if what == "backlash" else ()
    name = tmp_path / "contacts.xml" if what == "contacts" else "ergojr"
    simulator = MujocoSimulator.load(name, 0.02, effects=effects, threads=1)
    n = len(simulator.joints)
    model = silent(network("delta", simulator.joints))
    source, corrected = simulator.stepper(2), AugmentedStepper(simulator.stepper(2), model)
    initial = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 2 * n))
    commands = np.stack(wander((40, 40), n), axis=0)
    for stepper in (source, corrected):
        stepper.reset(initial)
    for step in range(40):
        assert np.array_equal(corrected.step(commands[:, step]), source.step(commands[:, step]))


@pytest.mark.parametrize("relative", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_a_network_that_knows_the_difference_reproduces_the_target(kind, relative):
    n, joints = 3, ("m1", "m2", "m3")
    arms = LinearSimulator.draw(0, joints), LinearSimulator.draw(1, joints)
    source, target = (arm.stepper(4) for arm in arms)
    stepper = LearnedStepper(source, knows(network(kind, joints, relative=relative), *arms))
    rng = np.random.default_rng(2)
    initial = rng.normal(size=(4, 2 * n))
    stepper.reset(initial)
    target.reset(initial)
    for _ in range(100):
        commands = rng.normal(size=(4, n))
        np.testing.assert_allclose(stepper.step(commands), target.step(commands), rtol=0, atol=1e-4)
    assert np.abs(target.states).max() > 0.1
    np.testing.assert_allclose(source.states, stepper.states, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_equals_its_members_alone(kind):
    simulator = pendulum()
    model = network(kind, ("pendulum",))
    initial = np.random.default_rng(0).normal(size=(5, 2))
    commands = np.stack(wander((30,) * 5), axis=0)
    wrap = AugmentedStepper if kind == "delta" else ForwardStepper
    together = wrap(simulator.stepper(5), model)
    together.reset(initial)
    rolled = np.stack([together.step(commands[:, step]) for step in range(30)], axis=1)
    for row in range(5):
        alone = wrap(simulator.stepper(1), model)
        alone.reset(initial[row : row + 1])
        for step in range(30):
            np.testing.assert_allclose(
                alone.step(commands[row : row + 1, step])[0], rolled[row, step], rtol=1e-6, atol=1e-6
            )


@pytest.mark.parametrize("kind", KINDS)
def test_a_reset_zeroes_the_memory_of_its_rows_only(kind):
    model = network(kind, ("pendulum",), seed=3)
    steppers = [LearnedStepper(pendulum().stepper(3), model) for _ in range(2)]
    initial = np.array([[0.1, 0.0], [0.4, 0.0], [-0.3, 0.0]])
    commands = np.stack(wander((40,) * 3), axis=0)
    for stepper in steppers:
        stepper.reset(initial)
        for step in range(20):
            stepper.step(commands[:, step])
    touched, going_on = steppers
    fresh = LearnedStepper(pendulum().stepper(1), model)
    touched.reset(initial[1:2], rows=np.array([1]))
    fresh.reset(initial[1:2])
    np.testing.assert_allclose(touched.states[1], initial[1], rtol=0, atol=1e-12)
    for step in range(20, 40):
        mixed, before = touched.step(commands[:, step]).copy(), going_on.step(commands[:, step])
        np.testing.assert_allclose(mixed[[0, 2]], before[[0, 2]], rtol=0, atol=1e-9)
        np.testing.assert_allclose(mixed[1], fresh.step(commands[1:2, step])[0], rtol=0, atol=1e-6)
    assert np.abs(mixed[1] - before[1]).max() > 1e-4, "the memory made no difference: the test shows nothing"


def test_the_source_stands_where_the_corrected_state_says():
    model = network("forward", ("pendulum",))
    source = pendulum().stepper(2)
    stepper = ForwardStepper(source, model)
    stepper.reset(np.array([[0.2, 0.0], [-0.5, 0.0]]))
    for commands in itertools.repeat(np.full((2, 1), 0.3), 10):
        states = stepper.step(commands)
    np.testing.assert_allclose(source.states, states, rtol=0, atol=1e-12)
    reference = pendulum().stepper(2)
    reference.set_states(states)
    np.testing.assert_allclose(stepper.site_positions("tip"), reference.site_positions("tip"), rtol=0, atol=1e-12)


def test_setting_states_keeps_the_memory():
    model = network("delta", ("pendulum",))
    kept, cleared = (LearnedStepper(pendulum().stepper(1), model) for _ in range(2))
    for stepper in (kept, cleared):
        stepper.reset(np.zeros((1, 2)))
        for _ in range(15):
            stepper.step(np.full((1, 1), 0.8))
    kept.set_states(np.zeros((1, 2)))
    cleared.reset(np.zeros((1, 2)))
    assert np.array_equal(kept.states, np.zeros((1, 2)))
    assert np.abs(kept.step(np.zeros((1, 1))) - cleared.step(np.zeros((1, 1)))).max() > 1e-5


def test_phi_and_psi_are_not_taken_for_each_other():
    with pytest.raises(CheckpointError, match=r"forward model.*delta"):
        AugmentedStepper(pendulum().stepper(1), network("forward", ("pendulum",)))
    with pytest.raises(CheckpointError, match=r"delta model.*forward"):
        ForwardStepper(pendulum().stepper(1), network("delta", ("pendulum",)))
    with pytest.raises(JointMismatch, match=r"elbow.*pendulum"):
        LearnedStepper(pendulum().stepper(1), network("delta", ("elbow",)))


def test_a_lost_simulation_stays_so_when_another_is_reset():
    stepper = LearnedStepper(pendulum().stepper(2), network("delta", ("pendulum",)))
    stepper.reset(np.zeros((2, 2)))
    stepper._diverged[0] = True
    stepper.reset(np.zeros((1, 2)), rows=np.array([1]))
    assert np.isnan(stepper.states[0]).all() and np.isfinite(stepper.states[1]).all()
    stepper.reset(np.zeros((1, 2)), rows=np.array([0]))
    assert np.isfinite(stepper.states).all()
