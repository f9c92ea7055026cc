"""How each hidden effect changes the numbers of an arm; written from the contract's table alone."""

from collections.abc import Callable, Mapping

import numpy as np

from nas_data.benchmarks.blind.plants.body import PlantBody
from nas_data.benchmarks.blind.plants.constants import Constants
from nas_data.benchmarks.blind.plants.vectors import about
from nas_data.benchmarks.blind.truth import Hidden, Truth
from nas_data.errors import UnknownName

Values = Mapping[str, float]
Joints = slice  # the joint that an effect sits in, or all of them


def payload(body: PlantBody, _: Joints, values: Values) -> None:
    """A point mass on the last link, x, y, z from its centre of mass; there, where they are left out."""
    place = np.array([values.get(axis, 0.0) for axis in "xyz"])
    share = values["mass"] / (body.masses[-1] + values["mass"])
    # the parallel axis theorem for both about their common centre of mass
    body.inertias[-1] += share * body.masses[-1] * (place @ place * np.eye(3) - np.outer(place, place))
    body.centres[-1] += share * place
    body.masses[-1] += values["mass"]


def base_tilt(body: PlantBody, _: Joints, values: Values) -> None:
    """The base is rolled about x, then pitched about the world's y: gravity turns the other way."""
    leaning = about(np.array([0.0, 1, 0]), values["pitch"]) @ about(np.array([1.0, 0, 0]), values["roll"])
    body.gravity = leaning.T @ body.gravity


def torque_limit(body: PlantBody, joint: Joints, values: Values) -> None:
    """The servo saturates at this torque."""
    body.force[joint] = (-values["torque"], values["torque"])


def stribeck_friction(body: PlantBody, joint: Joints, values: Values) -> None:
    """Friction that is largest at rest."""
    body.stribeck[joint] = values["torque"]
    body.kinetic_ratio[joint] = values["kinetic_ratio"]
    body.stribeck_velocity[joint] = values["stribeck_velocity"]


def cogging(body: PlantBody, joint: Joints, values: Values) -> None:
    """A torque with the period of the gear's teeth."""
    body.cogs[joint], body.cog_count[joint] = values["torque"], values["count"]
    body.cog_phase[joint] = values["phase"]


def cable(body: PlantBody, joint: Joints, values: Values) -> None:
    """A cable that pulls towards an angle from one side of it, and hangs loose on the other."""
    body.cable[joint], body.cable_angle[joint] = values["stiffness"], values["angle"]
    body.cable_side[joint] = values["side"]


def swinging_load(body: PlantBody, _: Joints, values: Values) -> None:
    """A weight that swings from the last link."""
    body.hang(values["mass"], values["length"], values["heading"])


def adds(field: str, parameter: str) -> Callable[[PlantBody, Joints, Values], None]:
    """Return the rule that adds a parameter to a number of the joint."""

    def apply(body: PlantBody, joint: Joints, values: Values) -> None:
        getattr(body, field)[joint] += values[parameter]

    return apply


def becomes(field: str, parameter: str) -> Callable[[PlantBody, Joints, Values], None]:
    """Return the rule that sets a number of the joint."""

    def apply(body: PlantBody, joint: Joints, values: Values) -> None:
        getattr(body, field)[joint] = values[parameter]

    return apply


def servo_stiffness(body: PlantBody, joint: Joints, values: Values) -> None:
    """The position gain is another."""
    body.gain[joint] *= values["factor"]


RULES: Mapping[str, Callable[[PlantBody, Joints, Values], None]] = {
    "backlash": becomes("play", "half_width"),
    "joint_compliance": becomes("spring", "stiffness"),
    "coulomb_friction": adds("friction", "torque"),
    "stribeck_friction": stribeck_friction,
    "viscous_friction": adds("viscous", "coefficient"),
    "load_friction": becomes("load_ratio", "ratio"),
    "rotor_inertia": adds("armature", "inertia"),
    "servo_stiffness": servo_stiffness,
    "torque_limit": torque_limit,
    "speed_limit": becomes("speed", "speed"),
    "command_delay": adds("delay", "delay"),
    "joint_offset": becomes("offset", "offset"),
    "deadband": becomes("deadband", "half_width"),
    "payload": payload,
    "base_tilt": base_tilt,
    "cogging": cogging,
    "cable": cable,
    "swinging_load": swinging_load,
}


def hide(constants: Constants, truth: Truth) -> PlantBody:
    """Return the arm with its base errors and its hidden effects.

    Raises:
        UnknownName: there is no rule for an effect.
    """
    body = PlantBody.of(constants, truth.base)
    # a swinging load makes the arm longer: what acts on all joints must have acted before
    for hidden in sorted(truth.hidden, key=lambda hidden: hidden.effect == "swinging_load"):
        if hidden.effect not in RULES:
            raise UnknownName("hidden effect", hidden.effect, RULES)
        RULES[hidden.effect](body, place(constants, hidden), hidden.parameters)
    return body


def place(constants: Constants, hidden: Hidden) -> Joints:
    """Return which rows an effect changes."""
    if hidden.joint is None:
        return slice(0, len(constants.joints))
    row = constants.joints.index(hidden.joint)
    return slice(row, row + 1)
