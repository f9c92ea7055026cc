"""Named + φ: the source with named effects and a learned correction of the residual."""

from nas_data.pairing import pair
from nas_data.studies.ablation.kinds import named
from nas_data.studies.ablation.kinds.base import ModelKind, TrainedPredictor, TrainingInput
from nas_data.studies.ablation.training import train


def learn(lesson: TrainingInput) -> TrainedPredictor:
    """Name effects, pair the subset with the source and its effects, and train φ on the pairs."""
    base = named.learn(lesson)
    assert base.source is not None
    simulator = base.source.simulator(lesson.data, threads=1)
    paired = pair(lesson.data, simulator)
    return TrainedPredictor(train("delta", paired, simulator, lesson.options, lesson.folder), base.source, base.named)


KIND = ModelKind("named + φ", learn, needs_source=True, names=True)
