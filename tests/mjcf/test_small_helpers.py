"""Names of added elements, and bodies that nothing drives."""

import mujoco
import numpy as np

from nas_data.mjcf.free_bodies import find_free_bodies
from nas_data.mjcf.unique_name import make_unique_name

SCENE = """<mujoco><worldbody>
<body name="arm"><joint name="hinge"/><geom size=".1"/><body name="hand"><geom size=".1"/></body></body>
<body name="ball"><freejoint/><geom size=".1"/><body name="pin"><joint/><geom size=".1"/></body></body>
<body name="top"><joint type="ball"/><geom size=".1"/></body>
</worldbody></mujoco>"""


def test_a_name_is_taken_as_it_is_or_gets_the_next_free_number():
    taken = {"band", "band_2"}
    find = {name: name for name in taken}.get
    assert make_unique_name(find, "play") == "play"
    assert make_unique_name(find, "band") == "band_3"


def test_bodies_on_free_and_ball_joints_are_found_with_all_that_hangs_on_them():
    model = mujoco.MjModel.from_xml_string(SCENE)
    names = np.array([model.body(number).name for number in range(model.nbody)])
    assert set(names[find_free_bodies(model)]) == {"ball", "pin", "top"}
