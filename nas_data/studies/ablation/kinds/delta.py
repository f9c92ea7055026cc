"""φ: the source with a correction learned from the subset."""

from nas_data.studies.ablation.kinds.base import ModelKind, TrainedPredictor, TrainingInput
from nas_data.studies.ablation.training import train


def learn(lesson: TrainingInput) -> TrainedPredictor:
    """Train φ on the subset as it is paired."""
    simulator = lesson.plain.simulator(lesson.data, threads=1)
    return TrainedPredictor(train("delta", lesson.data, simulator, lesson.options, lesson.folder), lesson.plain)


KIND = ModelKind("source + φ", learn, needs_source=True, needs_pairs=True)
