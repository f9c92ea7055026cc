"""ψ: the next state from state and command, without a source."""

from dataclasses import replace

from nas_data.studies.ablation.kinds.base import ModelKind, TrainedPredictor, TrainingInput
from nas_data.studies.ablation.training import train


def learn(lesson: TrainingInput) -> TrainedPredictor:
    """Train ψ on the subset; all kinds share a sweep's options, but stiction is for φ alone."""
    options = replace(lesson.options, stiction=False)
    return TrainedPredictor(train("forward", lesson.data, None, options, lesson.folder), None)


KIND = ModelKind("ψ", learn)
