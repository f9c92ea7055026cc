"""The paper's figure 6: policy return against number of recorded trajectories."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from nas_data.commands._experiment import PolicyExperimentCommand

if TYPE_CHECKING:
    from nas_data.studies.experiments.pipeline.sizes import Sizes


@dataclass(frozen=True, kw_only=True)
class ExperimentFigure6(PolicyExperimentCommand):
    """Train φ on nested subsets of a recording, and a policy in each augmented environment; find the sufficient size.

    Example: nas experiment figure6 --workers 2

    Example: nas experiment figure6 --methods nas named --counts 10 100 1000 --seeds 0 1 2
    """

    experiment: ClassVar[str] = "figure6"

    counts: tuple[int, ...] = ()
    """Numbers of trajectories; 10 to 2000 by default. They are subsets of one recording of 2000 (with --quick 40), so
    that others can be added later without repeating work. A larger number needs a larger recording and repeats
    everything."""
    methods: tuple[str, ...] = ()
    """Methods: nas (source + φ; default), forward (ψ), named (the source with the effects that `nas gap` names),
    named_nas (and φ on top), nas_few (source + φ, trained by the preset `few`), nas_symmetric (source + φ, by the
    preset `symmetric`)."""

    def chosen_methods(self) -> tuple[str, ...]:
        """Return the methods to compare."""
        return self.methods

    def sizes(self) -> "Sizes":
        """Return the sizes of the experiment with the given options."""
        return super().sizes().with_counts(self.counts)
