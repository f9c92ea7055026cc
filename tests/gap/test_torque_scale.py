"""All torques of a joint multiplied by one number: what it stands for, and which effect it makes unnecessary."""

import math

import mujoco
import pytest
from support.search_samples import arm, begun, fitted

from nas_data.effects.base import find_effect, parse
from nas_data.gap.search.constants import PRICE
from nas_data.gap.search.moves.replace_by_rival import fit_rivals
from nas_data.gap.search.torque_scale import find_sufficient_ratio, scale_effect

OWN = {"gain": 1.0, "damping": 0.05, "armature": 0.02, "frictionloss": 0.03}


def spec_of(**own: float) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(arm(**{**OWN, **own}))


@pytest.mark.parametrize(
    ("text", "parameter", "scaled"),
    [
        ("coulomb_friction:joint=j1,torque=0.01", "torque", 2 * (0.03 + 0.01) - 0.03),
        ("rotor_inertia:joint=j1,inertia=0.01", "inertia", 2 * (0.02 + 0.01) - 0.02),
        ("torque_limit:joint=j1,torque=0.4", "torque", 0.8),
        ("servo_stiffness:joint=j1,factor=0.4", "factor", 0.8),
        ("asymmetric_friction:joint=j1,torque=0.03,difference=-0.01", "difference", -0.02),
        ("backlash:joint=j1,half_width=0.02,stiffness=7", "stiffness", 14),
        ("backlash:joint=j1,half_width=0.02", "stiffness", math.inf),
        ("joint_offset:joint=j1,offset=0.03", "offset", 0.03),
        ("load_friction:joint=j1,ratio=0.3", "ratio", 0.3),
    ],
)
def test_what_is_in_proportion_to_a_torque_is_multiplied(text: str, parameter: str, scaled: float):
    """Of friction and inertia, the model's own amount counts too."""
    assert getattr(scale_effect(parse(text), spec_of(), 2.0), parameter) == pytest.approx(scaled)


def test_values_stay_within_their_bounds():
    high = find_effect("rotor_inertia").parameters[0].high
    assert scale_effect(parse("rotor_inertia:joint=j1,inertia=0.5"), spec_of(), 1e9).inertia == high
    assert 0 < scale_effect(parse("coulomb_friction:joint=j1,torque=0.01"), spec_of(), 0.1).torque < 1e-6


@pytest.mark.parametrize(
    ("text", "ratio"),
    [
        ("rotor_inertia:joint=j1,inertia=0.06", 0.25),
        ("servo_stiffness:joint=j1,factor=0.25", 4.0),
        ("torque_limit:joint=j1,torque=0.4", None),
        ("joint_offset:joint=j1,offset=0.03", None),
    ],
)
def test_a_ratio_of_all_torques_stands_for_an_effect(text: str, ratio: float | None):
    assert find_sufficient_ratio(parse(text), spec_of()) == ratio


def test_a_gain_is_a_rival_of_inertia_and_friction_in_proportion():
    """Without gravity nothing but the links' small inertia tells a third of the gain from three times all else."""
    level = arm(**OWN).replace("<option ", '<option gravity="0 0 0" ')
    weak = arm(**{**OWN, "gain": 0.3}).replace("<option ", '<option gravity="0 0 0" ')
    search = begun(level, target=weak, episodes=4)
    more = 1 / 0.3 - 1
    torques = [f"rotor_inertia:joint={joint},inertia={0.02 * more}" for joint in ("j1", "j2")]
    torques += [f"coulomb_friction:joint={joint},torque={0.03 * more}" for joint in ("j1", "j2")]
    torques += [f"viscous_friction:joint={joint},coefficient={0.05 * more}" for joint in ("j1", "j2")]
    heavy = fitted(search, *torques)
    rivals = fit_rivals(search, heavy, 0)
    assert rivals[0].score.over(heavy.score) < PRICE
    assert rivals[0].effects[-1].name() == "servo_stiffness"
    assert rivals[0].effects[-1].factor == pytest.approx(0.3, rel=0.05)
