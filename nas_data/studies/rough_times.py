"""Rough times of jobs on one core of a desktop computer, for estimates before anything has run.

Recording and naming are medians of docs/results/experiments/models.csv. With the other numbers, the training of φ takes
about its median there, 14 minutes.
"""

from nas_data.models.presets import TrainingOptions

RECORDING = 6.0  # [s] recording and pairing of an environment's episodes
NAMING = 350.0  # [s] naming effects in an arm of six joints
TRAINED_FRAME = 1e-5  # [s] frame of a training, whatever the network
TRAINED_WEIGHT = 1.1e-10  # [s] weight of the network, for each frame
TRAINING_START = 5.0  # [s]


def estimate_training(options: TrainingOptions, frames: float) -> float:
    """Return the time of a training of φ or ψ on some frames [s]."""
    weights = 8 * options.layers * options.hidden**2
    passes = options.updates * options.frames if options.updates else options.epochs * frames
    return TRAINING_START + passes * (TRAINED_FRAME + TRAINED_WEIGHT * weights)
