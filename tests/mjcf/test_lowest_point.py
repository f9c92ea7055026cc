"""Lowest points of an arm's shapes."""

import mujoco
import pytest

from nas_data.mjcf.lowest_point import find_arm_geoms, find_first_anchor, find_lowest_point


@pytest.mark.parametrize("shape", ["sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"])
def test_the_lowest_point_of_a_shape_is_where_a_plane_first_touches(shape: str):
    vertices = "0 0 0  .1 0 0  0 .07 0  0 0 .05  .03 .04 .06"
    geom = f'type="{shape}" size=".05 .03 .02"' if shape != "mesh" else 'type="mesh" mesh="m"'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="m" vertex="{vertices}"/></asset><worldbody><geom type="plane" size="9 9 1"/>'
        f'<body pos="0 0 .4"><joint axis="1 2 3"/><geom {geom} euler="20 40 60" margin="9"/></body></worldbody>'
        "</mujoco>"
    )
    data = mujoco.MjData(model)
    assert find_arm_geoms(model) == [1]
    assert find_first_anchor(model)[2] == pytest.approx(0.4)
    for angle in (-1.0, 0.3, 2.0):
        data.qpos[0] = angle
        mujoco.mj_forward(model, data)
        touched = min(contact.dist for contact in data.contact)
        assert find_lowest_point(model, data, [1]) == pytest.approx(touched, abs=1e-6)
