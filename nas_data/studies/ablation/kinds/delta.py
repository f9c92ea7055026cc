"""φ: the source with a correction learned from the subset."""

from nas_data.studies.ablation.kinds.base import Learned, Lesson, ModelKind
from nas_data.studies.ablation.training import train


def learn(lesson: Lesson) -> Learned:
    """Train φ on the subset as it is paired."""
    simulator = lesson.plain.simulator(lesson.data, threads=1)
    return Learned(train("delta", lesson.data, simulator, lesson.options, lesson.folder), lesson.plain)


KIND = ModelKind("source + φ", learn, needs_source=True, needs_pairs=True)
