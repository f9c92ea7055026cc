"""Every effect of the catalogue at a size that is typical of a hobby servo."""

from nas_data import registry
from nas_data.effects.base import Effect, find_effect, make_effect

NAMES = registry.list_names("effects")
OF_OBJECTS = {"object_mass", "object_friction"}
ON_ANY_ARM = [name for name in NAMES if name != "floor_contact"]  # the others need no collision shapes
JOINT = "m3"
# a size of each parameter that is typical of a hobby servo
TYPICAL = {
    ("backlash", "half_width"): 0.02,
    ("backlash", "stiffness"): 1.5,
    ("joint_compliance", "stiffness"): 1.5,
    ("coulomb_friction", "torque"): 0.02,
    ("stribeck_friction", "torque"): 0.05,
    ("stribeck_friction", "kinetic_ratio"): 0.5,
    ("stribeck_friction", "stribeck_velocity"): 0.3,
    ("asymmetric_friction", "torque"): 0.03,
    ("asymmetric_friction", "difference"): 0.02,
    ("viscous_friction", "coefficient"): 0.02,
    ("load_friction", "ratio"): 0.4,
    ("load_friction", "kinetic_ratio"): 0.3,
    ("load_friction", "stribeck_velocity"): 0.05,
    ("rotor_inertia", "inertia"): 0.002,
    ("servo_stiffness", "factor"): 0.7,
    ("servo_damping", "factor"): 0.4,
    ("integral_gain", "gain"): 0.5,
    ("torque_limit", "torque"): 0.1,
    ("motor_curve", "stall_torque"): 0.15,
    ("motor_curve", "no_load_speed"): 3.0,
    ("speed_limit", "speed"): 2.0,
    ("command_delay", "delay"): 0.025,
    ("joint_offset", "offset"): 0.03,
    ("deadband", "half_width"): 0.03,
    ("start_torque", "torque"): 0.06,
    ("acceleration_limit", "acceleration"): 20.0,
    ("payload", "mass"): 0.05,
    ("payload", "x"): 0.04,
    ("payload", "y"): 0.03,
    ("payload", "z"): 0.05,
    ("base_tilt", "roll"): 0.1,
    ("base_tilt", "pitch"): 0.1,
    ("gravity_compensation", "share"): 0.5,
    ("floor_contact", "depth"): 0.1,
    ("object_mass", "factor"): 4.0,
    ("object_friction", "factor"): 4.0,
}


def typical(name: str, joint: str | None = JOINT, **changed: float) -> Effect:
    kind = find_effect(name)
    values = {p.name: TYPICAL[name, p.name] for p in kind.parameters} | changed
    return make_effect(name, joint if kind.per_joint else None, values)
