"""Sizes at slides: steps, guesses, speeds and margins are parts of a slide's range, where a hinge's are radians."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.linear_samples import LinearSimulator

from nas_data.effects.base import Scales, find_effect, parse
from nas_data.errors import OptionError
from nas_data.excitations.triangle import Triangle
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.gap.residual_correlates import find_residual_correlate
from nas_data.gap.search.scales import estimate_scales
from nas_data.gap.write_model import write_model
from nas_data.joint_units import compute_angle_scales
from nas_data.models.jacobians import POSITION_STEP, estimate_jacobians
from nas_data.simulators.controls import find_command
from nas_data.simulators.limits import find_excitable_limits

PERIOD, REACH = 0.02, 0.04  # [s], [m] range of the slide
ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
<body pos="0 0 .5"><joint name="j" axis="0 1 0" range="-1.5 1.5" damping=".05" armature=".002"/>
<geom type="capsule" fromto="0 0 0 .15 0 0" size=".01" mass=".05"/><body pos=".15 0 0">
<joint name="g" type="slide" axis="0 0 1" range="-.02 .02" damping="2" armature=".05"/>
<geom type="box" size=".02 .005 .01" mass=".03"/></body></body></worldbody><actuator>{}</actuator></mujoco>"""
SERVOS = '<position joint="j" kp="20" kv=".3"/><position joint="g" kp="400" kv="8"/>'
SPEEDS = '<velocity joint="j" kv=".5"/><velocity joint="g" kv="20" gear="2"/>'
MOTORS = '<motor joint="j" gear="50"/><motor joint="g" gear="-20"/>'
AT = np.array([1.0, REACH / np.pi])  # what stands for a radian at each joint


def nominal_of(folder: Path, servos: str, commands: np.ndarray) -> tuple[Nominal, EpisodeBatch, np.ndarray]:
    """Return a model, what it was commanded (T, 2), and its positions."""
    (folder / "arm.xml").write_text(ARM.format(servos))
    blank = np.zeros((1, *commands.shape))
    evidence = EpisodeBatch(
        ("j", "g"), PERIOD, np.zeros((1, 2)), commands[None], blank, np.ones(blank.shape[:2], bool), np.arange(1)
    )
    nominal = Nominal.load(folder / "arm.xml", evidence)
    predicted = nominal.predict(evidence)
    return nominal, replace(evidence, measured=predicted), predicted


def swing(size: tuple[float, float]) -> np.ndarray:
    """Return commands of both joints, shape (T, 2)."""
    return np.sin(2 * np.pi * 0.5 * PERIOD * np.arange(150))[:, None] * np.array(size)


@pytest.mark.parametrize("effect", ["backlash", "deadband", "joint_offset"])
def test_first_guesses_of_widths_are_parts_of_a_slides_range(effect):
    hinge = Scales(20.0, 0.1, 0.01, 0.1, 1.0, 1.0)
    names = [parameter.name for parameter in find_effect(effect).parameters if not parameter.spread]
    at_hinge, at_slide = (find_effect(effect).guesses(one) for one in (hinge, replace(hinge, radian=AT[1])))
    for guess, other in zip(at_hinge, at_slide, strict=True):
        assert [other[name] for name in names] == pytest.approx([AT[1] * guess[name] for name in names])
    assert max(guess[names[0]] for guess in at_slide) < REACH / 10


@pytest.mark.parametrize(
    ("servos", "size", "largest"),
    [(SERVOS, (0.5, 0.01), None), (SPEEDS, (0.6, 0.02), None), (MOTORS, (0.1, 0.5), (0.1, 0.5))],
)
def test_large_torques_are_torques_whatever_is_commanded(tmp_path, servos, size, largest):
    nominal, evidence, predicted = nominal_of(tmp_path, servos, swing(size))
    found = estimate_scales(nominal, evidence, predicted)
    assert [one.radian for one in found] == pytest.approx(AT)
    torques = np.array([one.torque for one in found])
    if largest is None:
        simulator = nominal.simulator()
        data, forces = mujoco.MjData(simulator.model), []
        for row in simulator.layout.controls(evidence.commands[0]):
            data.ctrl[:] = row
            for _ in range(simulator.substeps):
                mujoco.mj_step(simulator.model, data)
            forces.append(np.abs(data.qfrc_actuator))
        largest = np.percentile(np.array(forces), 98, axis=0)
    assert torques == pytest.approx(largest, rel=0.5)


@pytest.mark.parametrize("actuator", ["velocity", "general"])
def test_a_model_written_with_another_velocity_gain_takes_the_same_speeds(tmp_path, actuator):
    general = '<general joint="{}" gainprm="{k}" biastype="affine" biasprm="0 0 -{k}"/>'
    servos = SPEEDS if actuator == "velocity" else general.format("j", k=0.5) + general.format("g", k=20)
    nominal, evidence, _ = nominal_of(tmp_path, servos, swing((0.6, 0.02)))
    before = nominal.simulator().layout.inputs
    (out := tmp_path / "out").mkdir()
    path, _ = write_model(out, nominal, [parse("command_delay:delay=0.02")], {"j.servo_damping": 0.7})
    written = mujoco.MjModel.from_xml_path(str(path))
    for place in range(2):
        _, control = find_command(written, place, "written")
        assert (control.kind, control.scale) == (".vel", pytest.approx(before.scale[place]))
    assert nominal.predict(evidence, (), {"j.servo_damping": 0.7}) != pytest.approx(evidence.measured, abs=1e-3)


def test_slopes_are_taken_over_a_part_of_a_slides_travel():
    asked: list[np.ndarray] = []

    class Watched(LinearSimulator):
        def predict(self, states, commands, continues=None):
            asked.append(states.copy())
            return super().predict(states, commands, continues)

    simulator = replace(Watched.draw(0, ("j", "g")), slides=("g",))
    rng = np.random.default_rng(0)
    states = np.c_[rng.uniform(-1, 1, 9), rng.uniform(-REACH / 2, REACH / 2, 9), np.zeros((9, 2))]
    predicted, commands = states @ simulator.a.T, np.zeros((9, 2))
    slopes = estimate_jacobians(simulator, states, commands, predicted)
    np.testing.assert_allclose(slopes, np.broadcast_to(simulator.a, slopes.shape), atol=1e-8)
    steps = [float((moved - states)[0, column]) for column, moved in enumerate(asked[-4:])]
    assert steps[0] == pytest.approx(POSITION_STEP) and steps[1] < REACH / 20 and steps[3] < 0.1 * steps[2]


def test_a_slides_direction_is_told_at_its_own_speeds():
    times = PERIOD * np.arange(300)
    rng = np.random.default_rng(0)
    q = np.stack([0.5 * np.sin(times), 0.5 * REACH * np.sin(2 * times)], axis=1)[None]
    counts = np.ones(q.shape[:2], bool)
    evidence = EpisodeBatch(("j", "g"), PERIOD, q[:, 0], q + 1e-4 * rng.normal(size=q.shape), q, counts, np.arange(1))
    errors = np.zeros_like(q)
    errors[..., 1] = 3e-4 * np.sign(np.cos(2 * times))
    assert find_residual_correlate(evidence, errors, 1, ("g",)) == "direction"


def test_a_slow_triangle_takes_a_slide_as_long_to_cross_as_a_hinge():
    low, high = np.array([-np.pi / 2, -REACH / 2]), np.array([np.pi / 2, REACH / 2])
    radians = compute_angle_scales(("j", "g"), ("g",), high - low)
    drawn = Triangle(speed=0.5, share=1.0).commands(np.random.default_rng(0), 4, 400, PERIOD, low, high, radians)
    speeds = np.abs(np.diff(drawn, axis=1)).max(axis=(0, 1)) / PERIOD
    assert speeds[1] / REACH == pytest.approx(speeds[0] / np.pi, rel=0.5)


def test_a_slide_without_a_range_is_not_driven_by_a_metre_and_the_remedy_works():
    low, high = np.array([-np.inf] * 2), np.array([np.inf] * 2)
    with pytest.raises(OptionError, match=r"^The slide g has no range; give its joint one in the model"):
        find_excitable_limits(low, high, ("j", "g"), (".pos", ".pos"), ("g",))
    low[1], high[1] = -0.02, 0.02
    assert find_excitable_limits(low, high, ("j", "g"), (".pos", ".pos"), ("g",))[1].tolist() == [np.pi / 2, 0.02]
