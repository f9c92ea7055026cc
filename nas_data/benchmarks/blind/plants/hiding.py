"""How each hidden effect, of the contract's table or outside of it, changes an arm's constants."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

import numpy as np

from nas_data.benchmarks.blind.case import Base, Hidden, Truth
from nas_data.benchmarks.blind.plants.constants import Constants, Hideable, Links, Servos
from nas_data.benchmarks.blind.plants.vectors import make_rotation
from nas_data.errors import UnknownName

NEUTRAL = {
    "viscous": 0.0, "stribeck": 0.0, "kinetic_ratio": 1.0, "stribeck_velocity": 1.0, "load_ratio": 0.0,
    "delay": 0.0, "speed": np.inf, "offset": 0.0, "deadband": 0.0, "play": 0.0, "spring": np.inf,
    "cogs": 0.0, "cog_count": 1.0, "cog_phase": 0.0, "cable": 0.0, "cable_angle": 0.0, "cable_side": 1.0,
    "eccentric": 0.0, "eccentric_count": 1.0, "eccentric_phase": 0.0, "coupling": 0.0,
    "heat_rise": 0.0, "heat_time": 1.0, "sag": 0.0, "stall": np.inf, "back_emf": 0.0, "acceleration": np.inf,
    "punch": 0.0, "integral": 0.0, "uneven": 0.0,
}  # fmt: skip
FLANK, HARDER = 500.0, 190.0  # [N m/rad] 0.2 N m sink into a gear's flank by 0.02 degrees; least multiple of the gain
PENDULUM = {
    "damping": 2e-5,  # [N m s/rad] a weight on a pin swings for seconds
    "force": (0.0, 0.0),
    "control": (-np.inf, np.inf),
    "flank": FLANK,
}
ROOT = 0.1  # share of a bending link's mass before the bend: the servo's horn
BEND_LOSS = 2e-3  # [s] damping over stiffness of a bending link: one of 10 Hz is damped to 6 % of critical

Values = Mapping[str, float]
Joints = slice  # the joint of an effect, or all joints


@dataclass
class PlantBody(Hideable, Servos, Links):
    """Constants of one arm with its hidden effects."""

    driven: tuple[int, ...]  # rows of the joints with a servo; a swinging load or a bending link adds an undriven one

    @classmethod
    def of(cls, constants: Constants, base: Base) -> "PlantBody":
        """Return the nominal arm with its base parameters multiplied."""
        n = len(constants.joints)
        nominal = {key: np.array(value) for key, value in vars(constants).items() if key != "joints"}
        flank = np.maximum(FLANK, HARDER * constants.gain)  # a larger servo has larger teeth
        body = cls(
            **nominal, **{key: np.full(n, value) for key, value in NEUTRAL.items()}, flank=flank, driven=tuple(range(n))
        )
        mass, damping = np.array(base.mass), np.array(base.damping)
        body.masses *= mass
        body.inertias *= mass[:, None, None]
        body.damping *= damping
        body.servo_damping *= damping
        body.armature *= base.armature
        body.gain *= base.stiffness
        return body

    def hang(self, mass: float, length: float, heading: float) -> None:
        """Hang a weight [kg] on a rod [m] from the last link's centre of mass, as one more link on a pin.

        The heading [rad] is the direction of the pin, as an angle about the last joint's axis.
        """
        axis = self.axes[-1]
        pin = point_across(axis, heading)
        rod = np.cross(pin, axis)  # perpendicular to the pin, so that the weight swings about it
        link = {"offsets": self.centres[-1], "turns": np.eye(3), "axes": pin, "masses": mass, "centres": length * rod}
        size = 1e-4 * mass * np.eye(3) * length**2 + 1e-8 * np.eye(3)
        self._insert(len(self.masses), link | {"inertias": size} | PENDULUM)

    def bend(self, row: int, stiffness: float, heading: float) -> None:
        """Let a link bend elastically at its root, beyond the joint's encoder: an undriven joint after the driven one.

        Args:
            row: Row of the link.
            stiffness: Torque per bend [N m/rad].
            heading: Direction of the bend's axis [rad], as an angle about the line to the link's centre of mass.
        """
        centre = self.centres[row]
        spring = {"gain": stiffness, "servo_damping": BEND_LOSS * stiffness, "force": (-np.inf, np.inf)}
        link = {"offsets": np.zeros(3), "turns": np.eye(3), "axes": point_across(centre, heading), "centres": centre}
        for key in ("masses", "inertias"):
            values = getattr(self, key)
            link[key] = (1 - ROOT) * values[row]
            values[row] *= ROOT
        self._insert(row + 1, link | PENDULUM | {"damping": 0.0} | spring)

    def _insert(self, row: int, link: Mapping[str, object]) -> None:
        """Insert an undriven link; constants that are not given are zero or neutral."""
        rest = dict.fromkeys(("sliding", "armature", "friction", "gain", "motor", "servo_damping"), 0.0)
        for key, value in (rest | NEUTRAL | dict(link)).items():
            rows = getattr(self, key)
            one = np.asarray(value, rows.dtype)[None]
            setattr(self, key, np.concatenate([rows[:row], one, rows[row:]]))
        self.driven = tuple(old + (old >= row) for old in self.driven)


def point_across(axis: np.ndarray, heading: float) -> np.ndarray:
    """Return the unit vector across an axis at an angle [rad] about it."""
    axis = axis / np.linalg.norm(axis)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return np.asarray(make_rotation(axis, heading) @ (across / np.linalg.norm(across)))


def stack_arms(bodies: list[PlantBody], repeats: int) -> dict[str, np.ndarray]:
    """Return each constant of several arms with a leading axis, every arm repeated: (B, …)."""
    names = [field.name for field in fields(PlantBody) if field.name != "driven"]
    return {name: np.repeat(np.stack([getattr(body, name) for body in bodies]), repeats, axis=0) for name in names}


def add_payload(body: PlantBody, _: Joints, values: Values) -> None:
    """Add a point mass to the last link at x, y, z from its centre of mass; default zero."""
    place = np.array([values.get(axis, 0.0) for axis in "xyz"])
    share = values["mass"] / (body.masses[-1] + values["mass"])
    # the parallel axis theorem for both about their common centre of mass
    body.inertias[-1] += share * body.masses[-1] * (place @ place * np.eye(3) - np.outer(place, place))
    body.centres[-1] += share * place
    body.masses[-1] += values["mass"]


def tilt_base(body: PlantBody, _: Joints, values: Values) -> None:
    """Roll the base about x, then pitch it about the world's y; gravity turns the opposite way."""
    leaning = make_rotation(np.array([0.0, 1, 0]), values["pitch"]) @ make_rotation(
        np.array([1.0, 0, 0]), values["roll"]
    )
    body.gravity = leaning.T @ body.gravity


def limit_torque(body: PlantBody, joint: Joints, values: Values) -> None:
    """Limit the servo's torque."""
    body.force[joint] = (-values["torque"], values["torque"])


def limit_torque_by_speed(body: PlantBody, joint: Joints, values: Values) -> None:
    """Let the servo's torque limit fall with speed."""
    body.stall[joint] = values["stall_torque"]
    body.back_emf[joint] = values["stall_torque"] / values["no_load_speed"]


def add_uneven_friction(body: PlantBody, joint: Joints, values: Values) -> None:
    """Add friction that differs by direction."""
    body.friction[joint] += values["torque"]
    body.uneven[joint] += values["difference"]


def add_play(body: PlantBody, joint: Joints, values: Values) -> None:
    """Add play, whose flanks yield if a stiffness is given."""
    body.play[joint] = values["half_width"]
    body.flank[joint] = values.get("stiffness", body.flank[joint])


def add_stribeck_friction(body: PlantBody, joint: Joints, values: Values) -> None:
    """Add friction that is largest at rest."""
    body.stribeck[joint] = values["torque"]
    body.kinetic_ratio[joint] = values["kinetic_ratio"]
    body.stribeck_velocity[joint] = values["stribeck_velocity"]


def add_cogging(body: PlantBody, joint: Joints, values: Values) -> None:
    """Add a torque with the period of the gear's teeth."""
    body.cogs[joint], body.cog_count[joint] = values["torque"], values["count"]
    body.cog_phase[joint] = values["phase"]


def add_cable(body: PlantBody, joint: Joints, values: Values) -> None:
    """Add a cable that pulls towards an angle from one side of it and is slack on the other."""
    body.cable[joint], body.cable_angle[joint] = values["stiffness"], values["angle"]
    body.cable_side[joint] = values["side"]


def add_eccentric_gear(body: PlantBody, joint: Joints, values: Values) -> None:
    """Add a gear that turns off its centre."""
    body.eccentric[joint], body.eccentric_count[joint] = values["amplitude"], values["count"]
    body.eccentric_phase[joint] = values["phase"]


def add_heat(body: PlantBody, joint: Joints, values: Values) -> None:
    """Let the servo weaken as it gets warm."""
    body.heat_rise[joint], body.heat_time[joint] = values["rise"], values["time"]


def bend_link(body: PlantBody, _: Joints, values: Values) -> None:
    """Let a link bend, which all joints up to its own feel."""
    body.bend(int(values["link"]), values["stiffness"], values["heading"])


def hang_load(body: PlantBody, _: Joints, values: Values) -> None:
    """Hang a swinging weight from the last link."""
    body.hang(values["mass"], values["length"], values["heading"])


def make_add_rule(field: str, parameter: str) -> Callable[[PlantBody, Joints, Values], None]:
    """Return a rule that adds a parameter to a constant of the joint."""

    def apply(body: PlantBody, joint: Joints, values: Values) -> None:
        getattr(body, field)[joint] += values[parameter]

    return apply


def make_set_rule(field: str, parameter: str) -> Callable[[PlantBody, Joints, Values], None]:
    """Return a rule that sets a constant of the joint."""

    def apply(body: PlantBody, joint: Joints, values: Values) -> None:
        getattr(body, field)[joint] = values[parameter]

    return apply


def scale_gain(body: PlantBody, joint: Joints, values: Values) -> None:
    """Scale the position gain."""
    body.gain[joint] *= values["factor"]


RULES: Mapping[str, Callable[[PlantBody, Joints, Values], None]] = {
    "backlash": add_play,
    "joint_compliance": make_set_rule("spring", "stiffness"),
    "coulomb_friction": make_add_rule("friction", "torque"),
    "stribeck_friction": add_stribeck_friction,
    "viscous_friction": make_add_rule("viscous", "coefficient"),
    "load_friction": make_set_rule("load_ratio", "ratio"),
    "rotor_inertia": make_add_rule("armature", "inertia"),
    "servo_stiffness": scale_gain,
    "torque_limit": limit_torque,
    "speed_limit": make_set_rule("speed", "speed"),
    "command_delay": make_add_rule("delay", "delay"),
    "joint_offset": make_set_rule("offset", "offset"),
    "deadband": make_set_rule("deadband", "half_width"),
    "payload": add_payload,
    "base_tilt": tilt_base,
    "motor_curve": limit_torque_by_speed,
    "acceleration_limit": make_set_rule("acceleration", "acceleration"),
    "start_torque": make_set_rule("punch", "torque"),
    "integral_gain": make_set_rule("integral", "gain"),
    "asymmetric_friction": add_uneven_friction,
    "cogging": add_cogging,
    "cable": add_cable,
    "swinging_load": hang_load,
    "heat": add_heat,
    "coupling": make_set_rule("coupling", "ratio"),
    "eccentric_gear": add_eccentric_gear,
    "supply_sag": make_set_rule("sag", "resistance"),
    "bending_link": bend_link,
}
ADDING_LINKS = frozenset({"swinging_load", "bending_link"})  # applied last: they move the rows of other joints


def hide(constants: Constants, truth: Truth) -> PlantBody:
    """Return the arm with its base errors and its hidden effects.

    Raises:
        UnknownName: there is no rule for an effect.
    """
    body = PlantBody.of(constants, truth.base)
    for hidden in sorted(truth.hidden, key=lambda hidden: hidden.effect in ADDING_LINKS):
        if hidden.effect not in RULES:
            raise UnknownName("hidden effect", hidden.effect, RULES)
        RULES[hidden.effect](body, select_rows(constants, hidden), hidden.parameters)
    return body


def select_rows(constants: Constants, hidden: Hidden) -> Joints:
    """Return the rows that an effect changes."""
    if hidden.joint is None:
        return slice(0, len(constants.joints))
    row = constants.joints.index(hidden.joint)
    return slice(row, row + 1)
