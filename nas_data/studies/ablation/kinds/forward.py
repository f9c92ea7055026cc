"""ψ: the next state from state and command, without a source."""

from nas_data.studies.ablation.kinds.base import ModelKind, TrainedPredictor, TrainingInput
from nas_data.studies.ablation.training import train


def learn(lesson: TrainingInput) -> TrainedPredictor:
    """Train ψ on the subset."""
    return TrainedPredictor(train("forward", lesson.data, None, lesson.options, lesson.folder), None)


KIND = ModelKind("ψ", learn)
