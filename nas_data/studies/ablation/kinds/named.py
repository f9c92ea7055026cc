"""Named: the source with the effects that `nas gap` names from the subset, without training."""

from nas_data.studies.ablation.kinds.base import ModelKind, TrainedPredictor, TrainingInput
from nas_data.studies.ablation.naming import name_effects, read_named


def learn(lesson: TrainingInput) -> TrainedPredictor:
    """Name effects, or use the given ones."""
    named = (
        read_named(lesson.effects, lesson.plain, lesson.data)
        if lesson.effects
        else name_effects(lesson.data, lesson.plain, lesson.root)
    )
    return TrainedPredictor(None, named.source, named)


KIND = ModelKind("named", learn, trains=False, needs_source=True, names=True)
