"""The paper's figure 6: what policies are worth by how many recorded trajectories were learned from."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from nas_data.commands._experiment import PolicyExperimentCommand

if TYPE_CHECKING:
    from nas_data.studies.experiments.pipeline.sizes import Sizes


@dataclass(frozen=True, kw_only=True)
class ExperimentFigure6(PolicyExperimentCommand):
    """Train φ on nested subsets of a recording, and a policy in each augmented environment; how much data is enough.

    Example: nas experiment figure6 --workers 2

    Example: nas experiment figure6 --methods nas named --counts 10 100 1000 --seeds 0 1 2
    """

    experiment: ClassVar[str] = "figure6"

    counts: tuple[int, ...] = ()
    """Numbers of trajectories that are learned from; 10 to 2000 where left out. They are parts of one recording of
    2000, with --quick 40, so that others can be added later and nothing is done twice; a larger number needs a larger
    recording, and everything anew."""
    methods: tuple[str, ...] = ()
    """What is made of them: nas (source + φ), forward (ψ), named (the source with the effects that `nas gap` names
    from them), named_nas (and φ on those), nas_few (source + φ, trained by the preset `few`), nas_symmetric
    (source + φ, by the preset `symmetric`); nas where left out."""

    def chosen_methods(self) -> tuple[str, ...]:
        """Return what is made of the trajectories."""
        return self.methods

    def sizes(self) -> "Sizes":
        """Return how large everything is, with what was given."""
        return super().sizes().with_counts(self.counts)
