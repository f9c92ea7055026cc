"""What is left of a case by who knows the answer: the true effects and base, in a model file like any other."""

from collections.abc import Mapping
from pathlib import Path

import mujoco

from nas_data.blind.findings import listed, mapping, number, sequence
from nas_data.blind.fresh import Fresh
from nas_data.blind.plants.mujoco_plant import multiply
from nas_data.blind.truth import Base
from nas_data.blind.write import NOMINAL
from nas_data.effects.base import add_effects, from_json
from nas_data.effects.edits.series import measured_tendon
from nas_data.errors import UnknownName

FINE = 0.0005  # [s] physics step at which what a step costs is below the noise


def least_error(folder: Path, answer: Mapping[str, object], fresh: Fresh) -> float | None:
    """Return the RMSE [rad] on the fresh episodes of a case's model with the true effects, at the true base.

    Fresh episodes start at the first measured pose, whatever was commanded before. Who names everything rightly still
    errs until a play, a band or a delayed command has been forgotten; nobody should be asked for less.

    Returns:
        None where the answer is beyond MJCF or outside the catalogue.
    """
    try:
        effects = [from_json(entry) for entry in listed(answer["effects"])]
    except UnknownName:
        return None
    if not all(effect.in_model for effect in effects):
        return None
    spec = mujoco.MjSpec.from_file(str(folder / NOMINAL))
    spec.option.timestep = min(spec.option.timestep, FINE)
    base = {
        name: tuple(number(value) for value in sequence(values)) for name, values in mapping(answer["base"]).items()
    }
    multiply(spec, fresh.joints, Base(**base))
    add_effects(spec, effects)
    for joint in fresh.joints:
        measured_tendon(spec, joint)
    return fresh.error_of(spec.compile(), folder / NOMINAL)
