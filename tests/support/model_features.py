"""The table of which features of a model are right, converted, held or refused, for both engines.

One arm is written in every way there is. Ways of one group are the same arm, so that the same commands must move them
alike; what they are compared with is played by plain MuJoCo, or by PyBullet on the first of the group.
`python tests/support/model_features.py` writes the page.
"""

import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from support.simulator_samples import load_integrals

from nas_data.errors import NasError
from nas_data.simulators.engines import ENGINES, load_simulator

PAGE = Path(__file__).parents[2] / "docs" / "model_features.md"
BEGIN, END = "<!-- made by tests/support/model_features.py -->", "<!-- end -->"
PERIOD, STEPS = 0.02, 10  # [s], physics steps
ALIKE = {"mujoco": 1e-9, "bullet": 1e-6}  # [rad or m]
ARM = """<mujoco><compiler angle="radian" autolimits="true"/><option timestep="0.002" integrator="implicitfast"/>
<default><geom contype="0" conaffinity="0"/></default>
<worldbody><body pos="0 0 0.5"><joint name="a" {joint} damping="0.05" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.01" mass="0.05"/>
<body pos="0.15 0 0"><joint name="b" {joint} damping="0.05" armature="0.002"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.03"/>{inside}</body></body>{beside}</worldbody>
<actuator>{actuators}</actuator>{after}</mujoco>"""
HINGE, SLIDE = 'axis="0 1 0" range="-1.5 1.5"', 'type="slide" axis="1 0 0" range="-0.5 0.5"'
EXTRA = """<body pos="0.1 0.02 0"><joint name="c" axis="0 1 0" armature="0.001"/>
<geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.01" mass="0.01"/></body>"""
TENDONS = """<tendon><fixed name="u"><joint joint="c" coef="1"/></fixed>
<fixed name="w"><joint joint="b" coef="1"/></fixed></tendon>"""

FOLLOWS = '<equality><joint joint1="c" joint2="b"/></equality>'


def fixed(name: str, **coefficients: float) -> str:
    """Return a fixed tendon by the coefficients of its joints."""
    parts = "".join(f'<joint joint="{joint}" coef="{share}"/>' for joint, share in coefficients.items())
    return f'<fixed name="{name}">{parts}</fixed>'


@dataclass(frozen=True)
class Way:
    """One way of writing an arm.

    Attributes:
        name: What the table calls it.
        group: Ways that are the same arm, by what is commanded and how large commands are.
        actuator: An actuator of the joint {j}.
        joint: The joints' attributes.
        inside: What else the last body holds.
        beside: What else the world holds.
        after: What follows the actuators.
    """

    name: str
    group: str
    actuator: str
    joint: str = HINGE
    inside: str = ""
    beside: str = ""
    after: str = ""

    @property
    def text(self) -> str:
        """The model."""
        actuators = "".join(self.actuator.format(j=j) for j in "ab")
        parts = {"joint": self.joint, "inside": self.inside, "beside": self.beside, "after": self.after}
        return ARM.format(actuators=actuators, **parts)


def general(gain: float, *bias: float, options: str = "") -> str:
    """Return an actuator by its numbers."""
    return f'<general joint="{{j}}" biastype="affine" gainprm="{gain}" biasprm="{" ".join(map(str, bias))}" {options}/>'


SERVO = '<position joint="{j}" kp="20" kv="0.3"/>'
WAYS = (
    Way("`position`", "position", SERVO),
    Way("`position` with a gear", "position", '<position joint="{j}" kp="5" kv="0.075" gear="2"/>'),
    Way("`position` with a negative gear", "position", '<position joint="{j}" kp="20" kv="0.3" gear="-1"/>'),
    Way("`position` on `jointinparent`", "position", SERVO.replace("joint=", "jointinparent=")),
    Way("`general`, gain = feedback", "position", general(20, 0, -20, -0.3)),
    Way("`general`, its own unit (0 … 255)", "position", general(0.2, 0, -20, -0.3, options='ctrlrange="-255 255"')),
    Way("`general`, its own unit and zero", "position", general(0.2, -25, -20, -0.3, options='ctrlrange="0 255"')),
    Way("`general`, its own unit and a gear", "position", general(0.1, 0, -5, -0.075, options='gear="2"')),
    Way("`pid` by position", "position", '<pid joint="{j}" kp="20" kv="0.3" input="pos"/>'),
    Way(
        "`pid` by position, velocity and feed-forward",
        "position",
        '<pid joint="{j}" kp="20" kv="0.3" input="pos vel ff"/>',
    ),
    Way("`pid` by position with a gear", "position", '<pid joint="{j}" kp="5" kv="0.075" gear="-2" input="pos"/>'),
    Way(
        "`dcmotor` by position",
        "position",
        '<dcmotor joint="{j}" motorconst="0.5" resistance="2" input="pos" controller="20 0 0.3"/>',
    ),
    Way(
        "`dcmotor` by position with a gear",
        "position",
        '<dcmotor joint="{j}" motorconst="0.5" resistance="2" input="pos" controller="5 0 0.075" gear="2"/>',
    ),
    Way("`position` with a filter", "filtered", '<position joint="{j}" kp="20" kv="0.3" timeconst="0.05"/>'),
    Way(
        "`position` with a filter and a gear",
        "filtered",
        '<position joint="{j}" kp="5" kv="0.075" gear="2" timeconst="0.05"/>',
    ),
    Way(
        "`pid` with integral and slew rate",
        "slewed",
        '<pid joint="{j}" kp="20" kv="0.3" ki="40" slewmax="4" input="pos"/>',
    ),
    Way(
        "`pid` with integral, slew rate and gear",
        "slewed",
        '<pid joint="{j}" kp="5" kv="0.075" ki="10" slewmax="8" gear="2" input="pos"/>',
    ),
    Way("`position` on a slide", "position of a slide", '<position joint="{j}" kp="50" kv="3"/>', SLIDE),
    Way(
        "`position` on a slide with a gear",
        "position of a slide",
        '<position joint="{j}" kp="0.5" kv="0.03" gear="10"/>',
        SLIDE,
    ),
    Way("`velocity`", "velocity", '<velocity joint="{j}" kv="1"/>'),
    Way("`velocity` with a gear", "velocity", '<velocity joint="{j}" kv="0.25" gear="-2"/>'),
    Way("`pid` by velocity", "velocity", '<pid joint="{j}" kp="0" kv="1" input="vel"/>'),
    Way(
        "`dcmotor` by velocity",
        "velocity",
        '<dcmotor joint="{j}" motorconst="0.5" resistance="2" input="vel" controller="0 0 1"/>',
    ),
    Way("`intvelocity`", "velocity of a setpoint", '<intvelocity joint="{j}" kp="20" actrange="-1.5 1.5"/>'),
    Way(
        "`intvelocity` with a gear",
        "velocity of a setpoint",
        '<intvelocity joint="{j}" kp="5" gear="2" actrange="-3 3"/>',
    ),
    Way("`motor`", "torque", '<motor joint="{j}"/>'),
    Way("`motor` with a gear", "torque", '<motor joint="{j}" gear="50" ctrlrange="-1 1"/>'),
    Way("`motor` with a negative gear", "torque", '<motor joint="{j}" gear="-1"/>'),
    Way("`general` with a gain", "torque", '<general joint="{j}" gainprm="3"/>'),
    Way("`pid` by feed-forward", "torque", '<pid joint="{j}" kp="0" kv="0" input="ff"/>'),
    Way("`motor` on a slide", "force", '<motor joint="{j}"/>', SLIDE),
    Way("`motor` on a slide with a gear", "force", '<motor joint="{j}" gear="20"/>', SLIDE),
    Way("`dcmotor` by voltage", "untold", '<dcmotor joint="{j}" motorconst="0.5" resistance="2"/>'),
    Way("`muscle`", "untold", '<muscle joint="{j}" lengthrange="0.1 1"/>'),
    Way("`cylinder`", "untold", '<cylinder joint="{j}"/>'),
    Way("`damper`", "untold", '<damper joint="{j}" kv="1" ctrlrange="0 1"/>'),
    Way("`general` with gain and back-EMF", "untold", general(0.25, 0, 0, -0.125)),
    Way("`general` with gain by length", "untold", '<general joint="{j}" gaintype="affine" gainprm="1 2 3"/>'),
    Way("`general`, integrated force", "untold", '<general joint="{j}" dyntype="integrator" actrange="-1 1"/>'),
    Way("no actuator", "untold", '<position joint="{j}" kp="20" kv="0.3"/>'.replace("{j}", "a")),
    Way(
        "`position` through a tendon of one joint",
        "position",
        '<position tendon="of_{j}" kp="80" kv="1.2"/>',
        after=f"<tendon>{fixed('of_a', a=0.5)}{fixed('of_b', b=0.5)}</tendon>",
    ),
    Way(
        "`position` through a tendon of a joint and its follower",
        "position of a gripper",
        '<position tendon="of_{j}" kp="20" kv="0.3"/>',
        inside=EXTRA,
        after=f"<tendon>{fixed('of_a', a=1)}{fixed('of_b', b=0.5, c=0.5)}</tendon>" + FOLLOWS,
    ),
    Way(
        "`position` through such a tendon with other coefficients",
        "position of a gripper",
        '<position tendon="of_{j}" kp="5" kv="0.075"/>',
        inside=EXTRA,
        after=f"<tendon>{fixed('of_a', a=2)}{fixed('of_b', b=1, c=1)}</tendon>" + FOLLOWS,
    ),
    Way(
        "`position` through a tendon of joints that are independent",
        "untold",
        SERVO.replace("{j}", "a") + '<position tendon="w" kp="20" kv="0.3"/>',
        inside=EXTRA,
        after=f"<tendon>{fixed('w', b=0.5, c=0.5)}</tendon>",
    ),
    Way(
        "`position` at a site",
        "untold",
        '<position name="{j}" site="end" gear="0 0 0 0 1 0" refsite="base" kp="20"/>',
        inside='<site name="end" pos="0.1 0 0"/>',
        beside='<site name="base"/>',
    ),
    Way(
        "a measured joint that follows by an `equality`",
        "untold",
        SERVO.replace("{j}", "a"),
        after='<equality><joint joint1="b" joint2="a"/></equality>',
    ),
    Way(
        "`equality/joint`: a follower",
        "equality",
        SERVO,
        inside=EXTRA,
        after=FOLLOWS,
    ),
    Way(
        "`equality/joint` by a curve: a follower",
        "curve",
        SERVO,
        inside=EXTRA,
        after='<equality><joint joint1="c" joint2="b" polycoef="0 1 0.5 0 0"/></equality>',
    ),
    Way(
        "`equality/tendon`: a follower",
        "tendon",
        SERVO,
        inside=EXTRA,
        after=TENDONS + '<equality><tendon tendon1="u" tendon2="w"/></equality>',
    ),
    Way(
        "`connect`: a closed loop",
        "loop",
        SERVO,
        inside='<body name="rod" pos="0.1 0 0"><joint axis="0 1 0" armature="0.001"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01" mass="0.01"/></body>',
        beside='<body name="rocker" pos="0.5 0 0.2"><joint axis="0 1 0" armature="0.001"/>'
        '<geom type="capsule" fromto="0 0 0 -0.25 0 0" size="0.01" mass="0.01"/></body>',
        after='<equality><connect body1="rod" body2="rocker" anchor="0 0 -0.3"/></equality>',
    ),
    Way(
        "a joint without a motor that the dataset lacks: held",
        "held",
        SERVO,
        inside=EXTRA,
    ),
    Way(
        "a tendon's servo that no joint of the dataset has: held",
        "held",
        SERVO + '<position tendon="u" kp="1"/>',
        inside=EXTRA,
        after=TENDONS,
    ),
    Way(
        "an object beside the arm",
        "object",
        SERVO,
        beside='<body pos="1 0 1"><joint name="puck" type="slide" axis="1 0 0"/><geom size="0.02" mass="0.1"/></body>',
    ),
)


def commands_of(way: Way) -> np.ndarray:
    """Return commands of one episode, shape (T, 2): changed every 10 rows, small enough for the kind."""
    sizes = {"torque": 0.02, "force": 0.2, "position of a slide": 0.2}
    size = sizes.get(way.group, 0.6)
    return np.repeat(np.random.default_rng(1).uniform(-size, size, (5, 2)), 10, axis=0)


@cache
def played(way: Way, engine: str) -> np.ndarray | str:
    """Return positions under the way's commands, shape (T, 2), or why the engine refuses it, as the package says."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        path.write_text(way.text)
        try:
            simulator = load_simulator(path, PERIOD, ("a", "b"), engine=engine, threads=1)
            return simulator.rollout(np.zeros((1, 4)), commands_of(way)[None])[0, :, :2]
        except NasError as error:
            return re.sub(r"\S*arm\.xml", "arm.xml", str(error))


def converts(way: Way) -> bool:
    """Whether a way's controls are other numbers than the commands."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        path.write_text(way.text)
        return not load_simulator(path, PERIOD, ("a", "b"), threads=1).layout.inputs.are_commands


@cache
def truth(group: str) -> np.ndarray:
    """Return the positions of the first way of a group, whose controls are its commands, by plain MuJoCo: (T, 2)."""
    way = next(way for way in WAYS if way.group == group)
    model = mujoco.MjModel.from_xml_string(way.text)
    data, rows = mujoco.MjData(model), []
    load_integrals(model, data)
    free = [model.joint(j).qposadr[0] for j in "ab"]
    for command in commands_of(way):
        data.ctrl[:2] = command
        mujoco.mj_step(model, data, STEPS)
        rows.append(data.qpos[free])
    return np.array(rows)


def verdict(way: Way, engine: str) -> str:
    """Return what the table says of a way: `right`, `converted`, `held` or `refused`, or `wrong`, which must not be."""
    motion = played(way, engine)
    if isinstance(motion, str):
        return "refused"
    if way.group == "held":
        return "held" if np.isfinite(motion).all() else "wrong"
    first = next(other for other in WAYS if other.group == way.group)
    reference = truth(way.group) if engine == "mujoco" else played(first, engine)
    if isinstance(reference, str) or not np.abs(motion - reference).max() < ALIKE[engine]:
        return "wrong"
    return "converted" if converts(way) else "right"


def rows() -> Iterator[str]:
    """Yield the lines of the table, then what is said of what is refused."""
    yield "| feature | what is commanded | MuJoCo | PyBullet |"
    yield "| --- | --- | --- | --- |"
    for way in WAYS:
        group = "" if way.group in {"untold", "equality", "curve", "tendon", "loop", "held", "object"} else way.group
        yield f"| {way.name} | {group} | {' | '.join(verdict(way, engine) for engine in ENGINES)} |"
    yield ""
    for way in WAYS:
        said = {engine: said for engine in ENGINES if isinstance(said := played(way, engine), str)}
        for engine, text in said.items():
            if engine == ENGINES[0] or said.get(ENGINES[0]) != text:
                yield f"- {way.name}{'' if engine == ENGINES[0] else ' (PyBullet)'}: “{text}”"


def page() -> str:
    """Return the page with a fresh table."""
    head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    return f"{head}{BEGIN}\n\n" + "\n".join(rows()) + f"\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"{PAGE}\n")
