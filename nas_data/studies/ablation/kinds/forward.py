"""ψ: the next state from state and command, without a source."""

from nas_data.studies.ablation.kinds.base import Learned, Lesson, ModelKind
from nas_data.studies.ablation.training import train


def learn(lesson: Lesson) -> Learned:
    """Train ψ on the subset."""
    return Learned(train("forward", lesson.data, None, lesson.options, lesson.folder), None)


KIND = ModelKind("ψ", learn)
