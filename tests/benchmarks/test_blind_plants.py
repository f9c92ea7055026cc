"""The plants of the blind benchmark: independent of the effects, true to MuJoCo where nothing hides."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.blind_samples import INDEPENDENT, arms, positions, reference, steps

from nas_data.benchmarks.blind import plants
from nas_data.benchmarks.blind.case import Base, Hidden, Truth
from nas_data.benchmarks.blind.catalogue import INSIDE, OUTSIDE
from nas_data.benchmarks.blind.plants.base import make_chain, stack_arms
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.hiding import PlantBody
from nas_data.benchmarks.blind.plants.motion import STEP

FOLDER = Path(plants.__file__).parent
NATIVE = "mujoco_plant.py"
NOMINAL = Truth(Base.nominal(6))
CLOSE = np.radians(0.1)


def imported(path: Path) -> set[str]:
    """Return every module that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {str(node.module)} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.name)
def test_no_plant_but_the_native_one_imports_the_effects(path):
    guilty = {name for name in imported(path) if name.startswith("nas_data.effects")}
    assert bool(guilty) == (path.name == NATIVE)


@pytest.mark.parametrize("plant", INDEPENDENT)
def test_an_independent_plant_does_not_even_load_the_effects(plant):
    code = f"import sys, nas_data.benchmarks.blind.plants.{plant}_plant; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert not [name for name in loaded if name.startswith("nas_data.effects")]


@pytest.mark.parametrize("arm", arms(), ids=lambda arm: arm.name)
def test_rigid_body_dynamics_equal_mujocos(arm):
    model, rng = arm.model(), np.random.default_rng(0)
    chain = make_chain(stack_arms([PlantBody.of(Constants.of(model), Base.nominal(6))], 4))
    q, v = rng.uniform(-1.5, 1.5, (4, 6)), rng.uniform(-5, 5, (4, 6))
    mass, bias = chain.dynamics(q, v)
    for row in range(4):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = q[row], v[row]
        mujoco.mj_forward(model, data)
        full = np.zeros((6, 6))
        mujoco.mj_fullM(model, data, full)
        np.testing.assert_allclose(mass[row] + np.diag(model.dof_armature), full, atol=1e-12)
        np.testing.assert_allclose(bias[row], data.qfrc_bias, atol=1e-12)


@pytest.mark.parametrize("plant", INDEPENDENT)
@pytest.mark.parametrize("arm", arms(), ids=lambda arm: arm.name)
def test_without_effects_a_plant_follows_mujoco(plant, arm):
    commands, poses = steps(1, 0.6, hold=30)
    played = positions(plant, arm, [NOMINAL], commands, poses)[0]
    error = np.sqrt(np.square(played - reference(arm, commands, poses)).mean(axis=(0, 1)))
    assert error.max() < CLOSE


@cache
def played_with_each_effect(plant: str) -> dict[str | None, np.ndarray]:
    """Return positions (1, T + 1, n) of an arm with each effect in its second joint, and with none."""
    arm = arms()[0]
    commands, poses = steps(1, 0.4, hold=20)
    truths = {None: NOMINAL}
    for name, kind in {**INSIDE, **OUTSIDE}.items():
        values = kind.draw(np.random.default_rng(5), Constants.of(arm.model()), 1, False)
        truths[name] = Truth(NOMINAL.base, (Hidden(name, "m2" if kind.per_joint else None, values),))
    return dict(zip(truths, positions(plant, arm, [*truths.values()], commands, poses), strict=True))


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=[pytest.mark.bullet, pytest.mark.slow])])
@pytest.mark.parametrize("effect", [*INSIDE, *OUTSIDE])
def test_each_effect_moves_the_joint_it_sits_in(plant, effect):
    played = played_with_each_effect(plant)
    assert np.isfinite(played[effect]).all()
    assert np.sqrt(np.square(played[effect] - played[None]).mean(axis=(0, 1)))[1] > np.radians(0.02)


@pytest.mark.bullet
def test_both_independent_plants_agree_on_hidden_effects():
    arm, rng = arms()[0], np.random.default_rng(6)
    commands, poses = steps(1, 0.4, hold=20)
    values = {name: INSIDE[name].draw(rng, Constants.of(arm.model()), 1, False) for name in ("backlash", "deadband")}
    truths = [Truth(Base.draw(6, rng), (Hidden(name, "m2", value),)) for name, value in values.items()]
    one, other = (positions(plant, arm, truths, commands, poses) for plant in ("numpy", "bullet"))
    assert np.sqrt(np.square(one - other).mean(axis=(1, 2))).max() < 3 * CLOSE


def test_friction_holds_a_loaded_joint_without_creep():
    arm = arms()[0]
    poses = np.full((1, 6), 0.4)
    hidden = Hidden("coulomb_friction", "m2", {"torque": 0.15})
    still = np.repeat(poses[:, None], 80, axis=1)
    played = positions("numpy", arm, [Truth(NOMINAL.base, (hidden,))], still, poses)[0]
    assert np.ptp(played[0, 40:, 1]) < 1e-9


def test_a_command_arrives_after_its_delay_and_not_before():
    arm = arms()[0]
    commands, poses = np.full((1, 30, 6), 0.5), np.zeros((1, 6))
    hidden = Hidden("command_delay", None, {"delay": 0.07})
    prompt, late = positions("numpy", arm, [NOMINAL, Truth(NOMINAL.base, (hidden,))], commands, poses)
    np.testing.assert_allclose(late[0, 7:], prompt[0, :24], atol=1e-12 + STEP * 0.5)
    np.testing.assert_allclose(late[0, :8], np.repeat(late[0, :1], 8, axis=0), atol=1e-15)
