"""Rough times of jobs on one core of a desktop computer, for estimates before anything has run."""

from nas_data.models.presets import TrainingOptions

RECORDING = 30.0  # [s] recording and pairing of an environment's episodes
NAMING = 300.0  # [s] naming effects in an arm of six joints
TRAINED_FRAME = 1e-5  # [s] frame of a free-running training, whatever the network
TRAINED_WEIGHT = 1.1e-10  # [s] weight of the network, for each frame
BEGINNING = 5.0  # [s] start of a training


def estimate_training(options: TrainingOptions) -> float:
    """Return the time of a training of φ or ψ [s]."""
    weights = 8 * options.layers * options.hidden**2
    return BEGINNING + options.updates * options.frames * (TRAINED_FRAME + TRAINED_WEIGHT * weights)
