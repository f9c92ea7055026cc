"""Effects of pushed objects change the object and its contacts, and nothing else."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from nas_data.effects.base import add_effects, parse
from nas_data.effects.edits.objects import find_objects
from nas_data.errors import ModelFileError
from nas_data.robots.base import find_robot

TABLE = Path(__file__).parents[1] / "support/table.xml"


def table(*effects: str) -> mujoco.MjModel:
    spec = find_robot(TABLE).spec()
    add_effects(spec, [parse(text) for text in effects])
    return spec.compile()


def contacts(model: mujoco.MjModel) -> dict[tuple[int, ...], np.ndarray]:
    """Return the friction of each contact while the hand leans on the puck."""
    data = mujoco.MjData(model)
    data.joint("puck").qpos[:3] = [0.25, 0.027, 0.0199]
    mujoco.mj_forward(model, data)
    return {tuple(sorted(map(int, contact.geom))): contact.friction.copy() for contact in data.contact}


def test_only_the_puck_is_an_object():
    model = table()
    assert [model.body(body).name for body in find_objects(model, "test")] == ["puck"]


@pytest.mark.parametrize("name", ["object_mass", "object_friction"])
def test_a_scene_without_an_object_is_refused(name):
    with pytest.raises(ModelFileError, match=f"{name} needs a pushed object"):
        add_effects(find_robot("ergojr").spec(), [parse(f"{name}:factor=2")])


def test_the_object_s_mass_and_inertia_are_scaled_and_no_other():
    before, after = table(), table("object_mass:factor=3")
    puck = before.body("puck").id
    scale = np.where(np.arange(before.nbody) == puck, 3.0, 1.0)
    assert after.body_mass == pytest.approx(scale * before.body_mass)
    assert after.body_inertia == pytest.approx(scale[:, None] * before.body_inertia)


@pytest.mark.parametrize("factor", [0.2, 1.5])
def test_friction_is_scaled_in_every_contact_of_the_object(factor):
    before, after = contacts(table()), contacts(table(f"object_friction:factor={factor}"))
    assert len(before) == 2  # table and hand
    assert before.keys() == after.keys()
    for geoms, friction in before.items():
        assert after[geoms][:2] == pytest.approx(factor * friction[:2])
        assert after[geoms][2:] == pytest.approx(friction[2:])


def test_factors_of_friction_multiply():
    twice = contacts(table("object_friction:factor=2", "object_friction:factor=0.25"))
    for geoms, friction in contacts(table("object_friction:factor=0.5")).items():
        assert twice[geoms] == pytest.approx(friction)
