"""Output of named effects as a model file with keyframes for plain MuJoCo, and as `effects.json`."""

import difflib
import json
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path

import mujoco
import numpy as np

from nas_data.atomic_file import write_atomic
from nas_data.dataset.features import POSITION
from nas_data.effects.base import Effect, add_effects
from nas_data.errors import OptionError
from nas_data.gap.nominal import Nominal, find_fine_timestep
from nas_data.mjcf.actuator_lookup import GOAL, find_goal_joints
from nas_data.mjcf.export import write_portable
from nas_data.mjcf.timestep import set_timestep
from nas_data.simulators.servo_registers import Values

MODEL, EFFECTS, DIFFERENCE = "model.xml", "effects.json", "model.diff"
LONG_NUMBER = re.compile(r"-?\d+\.\d{6,}(?:e[-+]?\d+)?")


def write_model(
    folder: Path,
    nominal: Nominal,
    effects: Sequence[Effect],
    factors: Mapping[str, float],
    timestep: float | None = None,
) -> tuple[Path, Path]:
    """Write `model.xml` with its assets, and `effects.json`.

    The model keeps names and order of joints and actuators, and has one sensor `<joint>.pos` per measured joint. Its
    timestep is the given one [s], or else fine enough for the noise. Effects that MJCF cannot express are only in
    `effects.json`.

    Returns:
        Paths of both files.
    """
    spec = nominal.make_spec(factors)
    set_timestep(spec, timestep or find_fine_timestep(nominal))
    before = spec.copy().compile()
    add_effects(spec, [effect for effect in effects if effect.in_model])
    keep_keyframes(spec, before)
    for joint in nominal.joints:
        add_position_sensor(spec, joint)
    # first, because it marks the folder as a report's even if the process is killed now
    written = write_effects(folder, effects, factors, nominal)
    write_portable(spec, nominal.robot.mjcf, folder / MODEL)
    return folder / MODEL, written


def write_difference(folder: Path, nominal: Nominal, given: str) -> Path:
    """Write `model.diff`, the difference of `model.xml` to the given model, both in MuJoCo's format.

    Args:
        folder: Folder with `model.xml`.
        nominal: Given model.
        given: Name of the given model.
    """
    spec = nominal.make_spec({})
    given_options = nominal.robot.spec().option  # `nominal` has a timestep that divides a control period
    for name in ("timestep", "integrator", "disableflags"):
        setattr(spec.option, name, getattr(given_options, name))
    for joint in nominal.joints:
        add_position_sensor(spec, joint)
    with tempfile.TemporaryDirectory() as place:
        write_portable(spec, nominal.robot.mjcf, Path(place, MODEL))
        before, after = (read_rounded_lines(parent / MODEL) for parent in (Path(place), folder))
    path = folder / DIFFERENCE
    write_atomic(path, "".join(difflib.unified_diff(before, after, given, MODEL)).encode())
    return path


def read_rounded_lines(model: Path) -> list[str]:
    """Return the lines of a model file with numbers of six digits."""
    text = model.read_text(encoding="utf-8")
    return LONG_NUMBER.sub(lambda found: f"{float(found[0]):.6g}", text).splitlines(keepends=True)


def write_effects(
    folder: Path,
    effects: Sequence[Effect],
    factors: Mapping[str, float],
    nominal: Nominal | None = None,
    contains: Callable[[Effect], bool] = attrgetter("in_model"),
) -> Path:
    """Write named effects and retuned base parameters for `nas record sim --effects` and `nas pair`.

    Args:
        folder: Output folder.
        effects: Effects.
        factors: Factors of base parameters.
        nominal: Model, for the units of its slides and the registers that it was given; None if it has neither.
        contains: Whether the model file contains an effect; by default those that MJCF expresses.
    """
    entries = [
        {**effect.to_json(nominal.slides if nominal else ()), "in_model_xml": contains(effect)} for effect in effects
    ]
    content: dict[str, object] = {"schema": 1, "effects": entries, "retuned": dict(factors)}
    if nominal and nominal.registers.values:
        content["registers"] = nominal.registers.values
    path = folder / EFFECTS
    write_atomic(path, json.dumps(content, indent=1).encode())
    return path


def read_factors(path: Path) -> dict[str, float]:
    """Return the retuned base parameters of an effects file or a report; empty if there are none.

    A `report.json` lists rounded changes of at least half a percent; an `effects.json` lists all.

    Raises:
        OptionError: they are not numbers.
    """
    content = json.loads(path.read_text(encoding="utf-8"))
    retuned = content.get("retuned", {}) if isinstance(content, dict) else {}
    try:
        if isinstance(retuned, list):
            retuned = {entry["parameter"]: entry["factor"] for entry in retuned}
        return {str(name): float(factor) for name, factor in retuned.items()}
    except (AttributeError, KeyError, TypeError, ValueError):
        raise OptionError(f"'retuned' in {path} must hold one factor per parameter; see `nas gap name`.") from None


def read_register_values(path: Path) -> Values:
    """Return the servo registers of an effects file or a report, by register and joint; empty if there are none.

    Raises:
        OptionError: they are not numbers.
    """
    content = json.loads(path.read_text(encoding="utf-8"))
    registers = content.get("registers") if isinstance(content, dict) else None
    try:
        return {
            str(name): {str(joint): float(value) for joint, value in values.items()}
            for name, values in (registers or {}).items()
        }
    except (AttributeError, TypeError, ValueError):
        raise OptionError(f"'registers' in {path} must hold one number per register and joint.") from None


def add_position_sensor(spec: mujoco.MjSpec, joint: str) -> None:
    """Give a joint an exact position sensor, with the name and place of an earlier one if it has one."""
    known = spec.sensor(joint + POSITION)
    if known is not None:
        known.cutoff, known.delay, known.interval, known.nsample = 0.0, 0.0, [0.0, 0.0], 0
        return
    sensor = spec.add_sensor(name=joint + POSITION)
    sensor.type = mujoco.mjtSensor.mjSENS_JOINTPOS
    sensor.objtype = mujoco.mjtObj.mjOBJ_JOINT
    sensor.objname = joint


def keep_keyframes(spec: mujoco.MjSpec, before: mujoco.MjModel) -> None:
    """Rewrite the keyframes; added joints are at their reference, and goals of servos at their joints.

    Args:
        spec: Model with effects, which is edited.
        before: Compiled model without effects.
    """
    if not spec.keys:
        return
    after = spec.compile()
    positions, speeds = find_kept_joints(before, after)
    for number, key in enumerate(spec.keys):
        qpos, qvel = after.qpos0.copy(), np.zeros(after.nv)
        qpos[positions], qvel[speeds] = before.key_qpos[number], before.key_qvel[number]
        for goal in find_goal_joints(after):
            own = after.joint(after.joint(goal).name.removesuffix(GOAL))
            qpos[after.jnt_qposadr[goal]] = qpos[own.qposadr[0]]
        key.qpos, key.qvel = qpos, qvel
        key.act = keep_activations(before, after, number)


def find_kept_joints(before: mujoco.MjModel, after: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the addresses of the original joints in `qpos` and `qvel` of the model with effects."""
    names = {before.joint(joint).name for joint in range(before.njnt)}
    kept = [joint for joint in range(after.njnt) if after.joint(joint).name in names]  # unnamed ones are the model's
    ends = [*after.jnt_qposadr[1:], after.nq], [*after.jnt_dofadr[1:], after.nv]
    positions = [index for joint in kept for index in range(after.jnt_qposadr[joint], ends[0][joint])]
    speeds = [index for joint in kept for index in range(after.jnt_dofadr[joint], ends[1][joint])]
    return np.array(positions, int), np.array(speeds, int)


def keep_activations(before: mujoco.MjModel, after: mujoco.MjModel, number: int) -> np.ndarray:
    """Return the actuator states of a keyframe; new states equal the control."""
    memories = np.zeros(after.na)
    for actuator in range(before.nactuator):
        first, own = int(after.actuator_actadr[actuator]), int(before.actuator_actadr[actuator])
        if own >= 0:
            count = int(before.actuator_actnum[actuator])
            memories[first : first + count] = before.key_act[number, own : own + count]
        elif first >= 0:
            memories[first] = before.key_ctrl[number, before.actuator_ctrladr[actuator]]
    return memories
