"""A floor or table that the arm touches and the model lacks."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.mujoco_loop import play

import nas_data as nas
from nas_data.effects.base import parse
from nas_data.errors import ModelFileError
from nas_data.gap.name import Finding, name
from nas_data.gap.problem import Problem

# the first joint's axis is 0.25 m above the ground
ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody>{}<body pos="0 0 .25"><joint name="lift" axis="0 1 0" range="-2 2" damping=".05" armature=".01"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".015" mass=".15"/><body pos=".2 0 0">
<joint name="elbow" axis="0 1 0" range="-2.5 2.5" damping=".03" armature=".006"/>
<geom type="box" pos=".08 0 0" size=".08 .02 .01" mass=".1"/></body></body></worldbody><actuator>
<position name="lift" joint="lift" kp="12" kv=".4"/><position name="elbow" joint="elbow" kp="8" kv=".2"/></actuator>
</mujoco>"""
# its first link alone
LEVER = ARM[: ARM.index('<body pos=".2 0 0">')] + ARM[ARM.index("</body></body>") + len("</body>") :]
LEVER = re.sub(r'<position name="elbow"[^>]*/>', "", LEVER)
RATE, ROWS, EPISODES, NOISE = 50, 200, 5, 3e-4


def record(arm: str, floor: str, episodes: int = EPISODES, low: frozenset[int] | None = None) -> nas.Dataset:
    """Record an arm on a floor by a loop of its own; all episodes reach low, or those of some numbers."""
    model, rng = mujoco.MjModel.from_xml_string(arm.format(floor)), np.random.default_rng(0)
    positions, commands = [], []
    times = np.arange(ROWS)[:, None] / RATE
    for number in range(episodes):
        speeds, phases = rng.uniform(1.0, 4.0, (3, 2)), rng.uniform(0, 2 * np.pi, (3, 2))
        asked = sum(np.sin(times * speed + phase) - np.sin(phase) for speed, phase in zip(speeds, phases, strict=True))
        reach = 0.0 if low is None or number in low else -0.6
        asked = np.clip(asked * [0.35, 0.5] + [0.3 + reach, 0.3] * np.minimum(times / 0.5, 1), -1.2, 1.2)
        asked[:5] = 0.0
        asked = asked[:, : model.nu]
        positions.append(play(model, asked, 500) + rng.normal(0, NOISE, (ROWS + 1, model.nu)))
        commands.append(asked)
    return nas.Dataset.from_arrays(positions, commands, rate=RATE, joints=("lift", "elbow")[: model.nu])


def find_names(dataset: nas.Dataset, arm: str, folder: Path) -> dict[tuple[str, str | None], Finding]:
    """Return what is named in a recording of the arm without a floor in its model, by name and joint."""
    (folder / "arm.xml").write_text(arm.format(""))
    problem = Problem.of(dataset, folder / "arm.xml", folder)
    findings = name(problem.train, problem.held).findings
    return {(finding.effect.name(), finding.effect.joint): finding for finding in findings}


@pytest.mark.slow
def test_no_floor_is_named_where_there_is_none(tmp_path):
    assert find_names(record(ARM, ""), ARM, tmp_path) == {}


@pytest.mark.parametrize(
    ("arm", "height", "episodes", "low"),
    [
        pytest.param(LEVER, 0.14, EPISODES, None, id="one joint"),
        pytest.param(ARM, 0.08, EPISODES, None, id="all", marks=pytest.mark.slow),
        pytest.param(ARM, 0.08, 24, frozenset({3, 10, 17}), id="few", marks=pytest.mark.slow),
    ],
)
def test_a_floor_is_named_that_all_or_few_episodes_touch(
    arm: str, height: float, episodes: int, low: frozenset[int] | None, tmp_path: Path
):
    floor = f'<geom type="plane" size="1 1 .1" pos="0 0 {height}" solref=".01 1"/>'
    found = find_names(record(arm, floor, episodes, low), arm, tmp_path)
    assert list(found) == [("floor_contact", None)]
    assert found["floor_contact", None].effect.depth == pytest.approx(0.25 - height, abs=0.002)
    assert found["floor_contact", None].confidence > 0.6


def test_an_arm_without_shapes_cannot_touch_a_floor(tmp_path):
    text = ARM.format('<geom type="plane" size="1 1 .1"/>').replace("<geom ", '<geom contype="0" conaffinity="0" ')
    with pytest.raises(ModelFileError, match="needs an arm with collision shapes"):
        parse("floor_contact:depth=0.2").edit(mujoco.MjSpec.from_string(text))
