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
from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Base, Hidden, Truth
from nas_data.benchmarks.blind.catalogue import INSIDE, OUTSIDE
from nas_data.benchmarks.blind.plants.base import make_chain, stack_arms
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.drive import STEP
from nas_data.benchmarks.blind.plants.hiding import PlantBody

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


def in_second_joint(name: str) -> Hidden:
    """Return an effect of the Ergo Jr, in its second joint where it is one of a joint."""
    kind = {**INSIDE, **OUTSIDE}[name]
    values = kind.draw(np.random.default_rng(5), Constants.of(arms()[0].model()), 1, False)
    return Hidden(name, "m2" if kind.per_joint else None, values)


RNG = np.random.default_rng(6)
OTHERS = [Truth(Base.draw(6, RNG), (in_second_joint(name),)) for name in ("backlash", "deadband")]
TRUTHS = {
    "none": NOMINAL,
    **{name: Truth(NOMINAL.base, (in_second_joint(name),)) for name in (*INSIDE, *OUTSIDE)},
    **dict(zip(("one other", "another"), OTHERS, strict=True)),
    "held": Truth(NOMINAL.base, (Hidden("coulomb_friction", "m2", {"torque": 0.15}),)),
    "late": Truth(NOMINAL.base, (Hidden("command_delay", None, {"delay": 0.07}),)),
}
FEW = ("none", "one other", "another")
JUMPS, STILL, STEP_UP = range(3)  # episodes
EPISODES = [steps(1, 0.4, hold=20), (np.full((1, 40, 6), 0.4), np.full((1, 6), 0.4))]
EPISODES += [(np.full((1, 40, 6), 0.5), np.zeros((1, 6)))]


@cache
def played(plant: str, names: tuple[str, ...] = tuple(TRUTHS)) -> dict[str, np.ndarray]:
    """Return positions (E, T + 1, n) of the Ergo Jr under each truth; in NumPy of all episodes, else of the first.

    There, many take hardly longer than one.
    """
    some = EPISODES if plant == "numpy" else EPISODES[: JUMPS + 1]
    commands, poses = (np.concatenate(parts) for parts in zip(*some, strict=True))
    return dict(zip(names, positions(plant, arms()[0], [TRUTHS[name] for name in names], commands, poses), strict=True))


def test_all_these_truths_hide_something_but_one():
    assert [name for name, truth in TRUTHS.items() if not truth.hidden] == ["none"]


def check_follows(shown: np.ndarray, arm: NominalArm) -> None:
    """Check that positions (T + 1, n) are those of MuJoCo."""
    error = np.sqrt(np.square(shown - reference(arm, *EPISODES[JUMPS])[0]).mean(axis=0))
    assert error.max() < CLOSE


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=pytest.mark.bullet)])
def test_without_effects_a_plant_follows_mujoco(plant):
    shown = played(plant) if plant == "numpy" else played(plant, FEW)
    check_follows(shown["none"][JUMPS], arms()[0])


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=[pytest.mark.bullet, pytest.mark.slow])])
def test_without_effects_a_plant_of_another_arm_follows_mujoco(plant):
    arm = arms()[1]
    check_follows(positions(plant, arm, [NOMINAL], *EPISODES[JUMPS])[0, 0], arm)


@pytest.mark.parametrize("plant", ["numpy", pytest.param("bullet", marks=[pytest.mark.bullet, pytest.mark.slow])])
@pytest.mark.parametrize("effect", [*INSIDE, *OUTSIDE])
def test_each_effect_moves_the_joint_it_sits_in(plant, effect):
    moved, plain = (played(plant)[name][JUMPS] for name in (effect, "none"))
    assert np.isfinite(moved).all()
    assert np.sqrt(np.square(moved - plain).mean(axis=0))[1] > np.radians(0.02)


@pytest.mark.parametrize("effect", INSIDE)
def test_each_effect_is_the_one_of_the_catalogue(effect):
    arm, (commands, poses) = arms()[0], EPISODES[JUMPS]
    plain, moved = positions("mujoco", arm, [NOMINAL, TRUTHS[effect]], commands, poses)[:, 0, :, 1]
    change, other = moved - plain, played("numpy")[effect][JUMPS, :, 1] - played("numpy")["none"][JUMPS, :, 1]
    assert np.sqrt(np.square(change - other).mean()) < np.radians(0.1) + 0.15 * np.sqrt(np.square(change).mean())


def test_an_integral_gain_begins_with_the_weight_and_removes_the_droop():
    wound, none = (played("numpy")[name][STILL, :, 1] for name in ("integral_gain", "none"))
    assert abs(none[-1] - 0.4) > np.radians(0.5), "nothing droops, and nothing is shown"
    assert np.abs(wound - 0.4).max() < np.radians(0.1)


@pytest.mark.bullet
def test_both_independent_plants_agree_on_hidden_effects():
    one, other = played("numpy"), played("bullet", FEW)
    apart = [np.sqrt(np.square(one[name] - other[name])[JUMPS].mean()) for name in FEW[1:]]
    assert max(apart) < 3 * CLOSE


def test_friction_holds_a_loaded_joint_without_creep():
    assert np.ptp(played("numpy")["held"][STILL, 20:, 1]) < 1e-9
    apart = played("numpy")["held"][STILL, -1, 1] - played("numpy")["none"][STILL, -1, 1]
    assert abs(apart) > np.radians(1), "friction holds it off where it would hang, or nothing is shown"


def test_a_command_arrives_after_its_delay_and_not_before():
    prompt, late = (played("numpy")[name][STEP_UP] for name in ("none", "late"))
    np.testing.assert_allclose(late[7:], prompt[:34], atol=1e-12 + STEP * 0.5)
    np.testing.assert_allclose(late[:8], np.repeat(late[:1], 8, axis=0), atol=1e-15)
