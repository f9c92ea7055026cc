"""Models and recordings as others make them: rates, lengths, damping ratios, gears, several actuators a joint."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nas_data.effects.base import add_effects, parse
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.gap.search.scales import estimate_scales
from nas_data.gap.search.screen import STRETCH_BOUNDS, stretch_effect
from nas_data.gap.windows import cut_windows
from nas_data.gap.write_model import write_model

ARM = """<mujoco><option timestep="{timestep}" integrator="implicitfast" gravity="0 0 0"/><worldbody>
<body><joint name="a" axis="0 1 0" damping="0.1" armature="0.02" {joint}/>
<geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass=".3"/>
<body pos=".2 0 0"><joint name="b" axis="0 1 0" damping="0.1" armature="0.02"/>
<geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass=".3"/></body></body></worldbody>
<actuator>{actuators}</actuator></mujoco>"""
SERVOS = '<position joint="a" kp="10" {0}/><position joint="b" kp="10" {0}/>'
INERTIAL = (
    "backlash:joint=a,half_width=0.05",
    "joint_compliance:joint=a,stiffness=20",
    "rotor_inertia:joint=a,inertia=0.05",
    "payload:mass=0.3",
    "servo_stiffness:joint=a,factor=0.5",
    "speed_limit:joint=a,speed=2",
)


def arm(actuators: str = SERVOS.format('kv="1"'), joint: str = "", timestep: float = 0.002) -> str:
    return ARM.format(actuators=actuators, joint=joint, timestep=timestep)


def episodes(lengths: list[int], period: float = 0.01) -> EpisodeBatch:
    """Episodes of some lengths whose measured rows are numbered."""
    longest = max(lengths)
    rows = np.repeat(np.arange(longest)[None, :, None], len(lengths), axis=0).repeat(2, axis=2) * 1e-4
    counts = np.arange(longest) < np.array(lengths)[:, None]
    return EpisodeBatch(("a", "b"), period, np.zeros((len(lengths), 2)), rows, rows, counts, np.arange(len(lengths)))


@given(lengths=st.lists(st.integers(20, 4000), min_size=2, max_size=12), rows=st.integers(500, 30_000))
@settings(max_examples=60, deadline=None)
def test_no_row_is_evidence_twice_over(lengths: list[int], rows: int):
    evidence = episodes(lengths)
    cut = cut_windows(evidence, rows)
    firsts = list(zip(cut.numbers.tolist(), cut.measured[:, 0, 0].tolist(), strict=True))
    assert len(set(firsts)) == len(firsts)
    assert cut.mask.sum() <= 1.5 * evidence.mask.sum()
    if rows >= 2 * evidence.mask.size:
        assert set(cut.numbers) == set(range(len(lengths)))  # none is left out while there is room


def test_a_long_episode_leaves_room_for_the_short_ones():
    cut = cut_windows(episodes([300] * 19 + [2000]), 24_000)
    assert sorted(cut.numbers.tolist()) == [*range(19), *[19] * 4]


def test_episodes_hardly_longer_than_a_window_stay_whole():
    evidence = episodes([520] * 20)
    assert cut_windows(evidence, 24_000).commands.shape == evidence.commands.shape


@pytest.mark.parametrize(
    ("rate", "timestep", "integrator"),
    [
        (30, 0.0003, "implicitfast"),
        (50, 0.003, "implicitfast"),
        (60, 0.004, "implicitfast"),
        (100, 0.002, "implicitfast"),
        (1000, 0.002, "implicitfast"),
        (30, 0.004, "RK4"),
        (60, 0.002, "RK4"),
        (100, 0.003, "RK4"),
        (1000, 0.0003, "RK4"),
    ],
)
def test_written_steps_make_whole_control_periods(rate: int, timestep: float, integrator: str, tmp_path: Path):
    (tmp_path / "arm.xml").write_text(arm(timestep=timestep).replace("implicitfast", integrator))
    nominal = Nominal.load(tmp_path / "arm.xml", episodes([50, 50], 1 / rate))
    for chosen in (None, float(nominal.spec.option.timestep)):
        model, _ = write_model(tmp_path, nominal, [], {}, chosen)
        substeps = 1 / rate / mujoco.MjModel.from_xml_path(str(model)).opt.timestep
        assert substeps == pytest.approx(round(substeps), abs=1e-9)
        assert substeps > 0.5


@pytest.mark.parametrize("effect", INERTIAL)
@pytest.mark.parametrize("names", ["", "named"])
def test_damping_that_a_model_gives_as_a_ratio_stays(effect: str, names: str):
    actuators = SERVOS.format('dampratio="1"')
    if names:
        actuators = actuators.replace('joint="a"', 'name="a" joint="a"')
    spec = mujoco.MjSpec.from_string(arm(actuators))
    before = spec.copy().compile().actuator_biasprm[:, 2]
    add_effects(spec, [parse(effect)])
    assert np.array_equal(spec.compile().actuator_biasprm[:2, 2], before)


def test_servo_damping_acts_on_a_damping_ratio_and_is_a_base_parameter(tmp_path: Path):
    (tmp_path / "arm.xml").write_text(arm(SERVOS.format('dampratio="1"')))
    nominal = Nominal.load(tmp_path / "arm.xml", episodes([50, 50]))
    kv = nominal.spec.copy().compile().actuator_biasprm[0, 2]
    changed = nominal.simulator([parse("servo_damping:joint=a,factor=0.5")]).model
    assert changed.actuator_biasprm[0, 2] == pytest.approx(0.5 * kv)
    assert "a.servo_damping" in {parameter.name for parameter in nominal.base}


def settled(effect: str, joint: str = "", command: float = 0.4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Torques, speeds and positions of the first joint on the way to a command, with a gear of 2 at its servo."""
    spec = mujoco.MjSpec.from_string(arm(SERVOS.format('kv="0.2" gear="2"'), joint))
    add_effects(spec, [parse(effect)])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = command
    rows = []
    for _ in range(3000):
        mujoco.mj_step(model, data)
        rows.append((data.qfrc_actuator[0], data.qvel[0], data.qpos[0]))
    torques, speeds, positions = np.array(rows).T
    return torques, speeds, positions


@pytest.mark.parametrize("joint", ["", 'actuatorfrcrange="-1 1"'])
@pytest.mark.parametrize("torque", [0.5, 3.0])
def test_a_torque_limit_is_that_of_the_joint_whatever_the_model_says(joint: str, torque: float):
    torques, *_ = settled(f"torque_limit:joint=a,torque={torque}", joint)
    assert np.abs(torques).max() == pytest.approx(torque)


def test_offset_and_speed_are_those_of_the_joint():
    *_, plain = settled("joint_offset:joint=a,offset=1e-9")
    *_, shifted = settled("joint_offset:joint=a,offset=0.1")
    assert shifted[-1] - plain[-1] == pytest.approx(0.1, abs=1e-4)
    _, speeds, _ = settled("speed_limit:joint=a,speed=0.2", command=2.0)
    assert np.median(speeds[1000:2000]) == pytest.approx(0.2, rel=0.02)


def test_commands_go_to_the_servo_and_not_to_a_damper_before_it(tmp_path: Path):
    both = '<velocity joint="{0}" kv="1"/><position joint="{0}" kp="10"/>'
    (tmp_path / "arm.xml").write_text(arm(both.format("a") + both.format("b")))
    simulator = Nominal.load(tmp_path / "arm.xml", episodes([50, 50])).simulator()
    assert set(simulator.kinds) == {".pos"}
    assert simulator.layout.control.tolist() == [1, 3]


@pytest.mark.parametrize("share", [0.2, 0.45, 0.8])
@pytest.mark.parametrize("stretch", [STRETCH_BOUNDS[0], 0.3, 1.0, STRETCH_BOUNDS[1]])
def test_a_torque_limit_is_never_sought_above_what_the_model_gives(share: float, stretch: float, tmp_path: Path):
    (tmp_path / "arm.xml").write_text(arm(SERVOS.format('kv="1" forcerange="-2 2"')))
    evidence = episodes([200, 200])
    evidence = EpisodeBatch(**{**vars(evidence), "commands": np.where(evidence.measured < 1e-2, 0.0, 1.5)})
    nominal = Nominal.load(tmp_path / "arm.xml", evidence)
    size = estimate_scales(nominal, evidence, nominal.predict(evidence))[0]
    guess = parse(f"torque_limit:joint=a,torque={share * size.torque}")
    found = stretch_effect(guess, stretch, guess.vanishing_value(size))
    assert 0 < found.torque < size.torque <= 2.0
    assert stretch_effect(guess, 1.0, guess.vanishing_value(size)).torque == pytest.approx(guess.torque)
