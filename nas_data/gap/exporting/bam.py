"""Export as files for `bam.model.load_model` of BAM (github.com/Rhoban/bam), one per joint.

BAM describes a servo by its motor. With a position error e and the speed ω its actuator `sts3215` gives the torque

    (k_t / R) · V_in · clip(k_p · g · r · e, ±d) − (k_t² / R) · ω

where V_in, k_p, g and d are its constants, r is the parameter `error_gain_ratio`, and `max_velocity` limits the goal's
speed. With the gain K, the velocity feedback D and the largest torque L of a joint,

    k_t / R = L / (V_in · d),   k_t = D / (k_t / R),   r = K · d / (L · k_p · g);

without a torque limit, r is 1 and k_t / R is K / (V_in · k_p · g). Friction is M1 to M4 of Rhoban's paper
(arXiv:2410.08650): K_l · |τ_m − τ_ext| is 2 K_l · |τ_m| for a joint at rest, so that K_l is half of our ratio.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from nas_data.atomic_file import make_file_names, write_atomic
from nas_data.gap.exporting.identified import Quantity

FOLDER = "bam"
ACTUATOR = "sts3215"  # BAM's actuator with parameters for gain, torque limit and speed limit
VOLTAGE = 7.4  # [V] V_in of that actuator
FIRMWARE_GAIN = 32.0  # k_p of that actuator
ERROR_GAIN = 0.166  # [1/rad] g of that actuator
LARGEST_DUTY = 0.97  # d of that actuator
CURVATURE = 2.0  # BAM's alpha: our friction falls with exp(−(v / v_s)²)

PLAIN = {  # our name: BAM's
    "armature": "armature",
    "speed_limit": "max_velocity",
    "command_delay": "command_delay",
    "viscous_friction": "friction_viscous",
}
KEPT = {*PLAIN, "gain", "servo_damping", "torque_limit", "dry_friction", "load_friction"}
OF_LINKS = {"mass"}  # quantities of links, not of servos; they stay in model.xml
STRIBECK = {"stribeck_friction.torque", "stribeck_friction.kinetic_ratio", "stribeck_friction.stribeck_velocity"}
FALLING_LOAD = {"load_friction.ratio", "load_friction.kinetic_ratio", "load_friction.stribeck_velocity"}


def write_bam(folder: Path, joints: Sequence[str], quantities: Sequence[Quantity]) -> tuple[Path, list[str]]:
    """Write `bam/JOINT.json` for every hinge; return the folder, and a sentence for each quantity that is lost.

    Args:
        folder: Output folder.
        joints: Measured hinges; BAM has no slides.
        quantities: Quantities of the identified model.
    """
    place = folder / FOLDER
    place.mkdir(parents=True, exist_ok=True)
    arm = {each.name: each.value for each in quantities if each.joint is None}
    lines = [f"{', '.join(sorted({q.name for q in quantities if q.interval}))}: their ranges"]
    lines = lines if any(quantity.interval for quantity in quantities) else []
    names = make_file_names(joints)
    for joint in joints:
        own = {each.name: each.value for each in quantities if each.joint == joint}
        if "command_delay" in arm:
            own["command_delay"] = own.get("command_delay", 0.0) + arm["command_delay"]  # both act
        content, lost = convert_parameters(own)
        write_atomic(place / f"{names[joint]}.json", json.dumps(content, indent=1).encode())
        lines += [f"{joint}: {what}" for what in lost]
    return place, lines + [f"the arm's {name}" for name in arm if name != "command_delay"]


def convert_parameters(own: Mapping[str, float]) -> tuple[dict[str, str | float], list[str]]:
    """Return BAM's parameters of a joint, and the quantities that they do not express.

    Args:
        own: The joint's quantities by name [SI].
    """
    content: dict[str, str | float] = {"actuator": ACTUATOR, "friction_base": own.get("dry_friction", 0.0)}
    content |= {"friction_viscous": 0.0} | {theirs: own[ours] for ours, theirs in PLAIN.items() if ours in own}
    has_stribeck, load_falls = own.keys() >= STRIBECK, own.keys() >= FALLING_LOAD
    falls, has_load = has_stribeck or load_falls, load_falls or "load_friction" in own
    content["model"] = {(0, 0): "m1", (1, 0): "m2", (0, 1): "m3", (1, 1): "m4"}[falls, has_load]
    if falls:
        share = 1 - own.get("stribeck_friction.kinetic_ratio", 1.0)
        content["friction_stribeck"] = own.get("stribeck_friction.torque", 0.0) * share
        # BAM has one velocity for both
        kind = "stribeck_friction" if has_stribeck else "load_friction"
        content["dtheta_stribeck"] = own[f"{kind}.stribeck_velocity"]
        content["alpha"] = CURVATURE
    if has_load:
        kinetic, ratio = own.get("load_friction.kinetic_ratio", 1.0), own.get("load_friction.ratio", 0.0)
        content["load_friction_base"] = kinetic * (ratio or own.get("load_friction", 0.0)) / 2
        if falls:
            content["load_friction_stribeck"] = (1 - kinetic) * ratio / 2
    known = (STRIBECK if has_stribeck else set()) | (FALLING_LOAD if load_falls else set())
    lost = sorted(own.keys() - KEPT - OF_LINKS - known)
    if has_stribeck and load_falls:
        lost.append("load_friction.stribeck_velocity")
    gain, feedback, limit = (own.get(name, 0.0) for name in ("gain", "servo_damping", "torque_limit"))
    if gain and feedback:
        per_volt = limit / (VOLTAGE * LARGEST_DUTY) if limit else gain / (VOLTAGE * FIRMWARE_GAIN * ERROR_GAIN)
        content["kt"] = feedback / per_volt
        content["R"] = feedback / per_volt**2
        content["error_gain_ratio"] = gain / (per_volt * VOLTAGE * FIRMWARE_GAIN * ERROR_GAIN)
    else:
        missing = "position servo" if not gain else "velocity feedback, which is BAM's back-EMF"
        lost += [f"kt and R, as the joint has no {missing}", *(["gain"] if gain else [])]
        lost += ["torque_limit"] if limit else []
    return content, lost
