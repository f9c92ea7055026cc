"""What is left of a case by who knows the answer: the true effects and base, in a model file like any other."""

from pathlib import Path

import mujoco
import numpy as np

from nas_data.benchmarks.blind.answer import SealedAnswer
from nas_data.benchmarks.blind.fresh import Fresh
from nas_data.benchmarks.blind.plants.mujoco_plant import multiply
from nas_data.benchmarks.blind.write import NOMINAL
from nas_data.effects.base import Effect, Scales, add_effects, find_joint_actuator, make_effect
from nas_data.effects.edits.series import ensure_measured_tendon
from nas_data.effects.edits.servo import read_force_range, read_servo_stiffness
from nas_data.errors import ModelFileError, UnknownName

WINDOW = 0.05  # [s] over which speeds are taken
LEAN = 0.5  # [rad] of error at which a servo without limits gives a large torque
FINE = 0.0005  # [s] physics step at which what a step costs is below the noise


def compute_oracle_error(folder: Path, answer: SealedAnswer, fresh: Fresh) -> float | None:
    """Return the RMSE [rad] on the fresh episodes of a case's model with the true effects, at the true base.

    Fresh episodes start at the first measured pose, whatever was commanded before. Who names everything rightly still
    errs until a play, a band or a delayed command has been forgotten; nobody should be asked for less.

    Returns:
        None where the answer is outside the catalogue or beyond a model file, or the model left all bounds.
    """
    try:
        effects = [make_effect(entry.effect, entry.joint, entry.parameters) for entry in answer.effects]
    except UnknownName:
        return None
    spec = mujoco.MjSpec.from_file(str(folder / NOMINAL))
    spec.option.timestep = min(spec.option.timestep, FINE)
    multiply(spec, fresh.joints, answer.base)
    forms = [effect.written_form(measure_scales(spec, effect, fresh)) for effect in effects]
    try:
        add_effects(spec, [form for form in forms if form is not None])
    except ModelFileError:
        return None
    for joint in fresh.joints:
        ensure_measured_tendon(spec, joint)
    return None if None in forms else fresh.error_of(spec.compile(), folder / NOMINAL)


def measure_scales(spec: mujoco.MjSpec, effect: Effect, fresh: Fresh) -> Scales:
    """Return what is large at an effect's joint, by model and fresh episodes; at the first one for the arm's effects.

    A load friction's form in a file is made for a torque and a speed, and for nothing else.
    """
    joint = fresh.joints[0] if effect.joint is None else effect.joint
    gap = max(1, round(WINDOW * fresh.rate))
    moved = np.abs(fresh.positions[:, gap:] - fresh.positions[:, :-gap])[..., fresh.joints.index(joint)]
    speed = float(np.percentile(moved, 98)) * fresh.rate / gap
    limits = read_force_range(find_joint_actuator(spec, joint))
    torque = max(map(abs, limits)) if limits else read_servo_stiffness(spec, joint) * LEAN
    return Scales(read_servo_stiffness(spec, joint), 0.0, 0.0, 0.0, torque, speed)
