"""One policy for a number of trajectories: φ learns from a nested subset, the policy in the source with that φ."""

from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.ablation.amount import Amount
from nas_data.ablation.subsets import draw
from nas_data.dataset.dataset import Dataset
from nas_data.envs.loop.plant import Plant
from nas_data.experiments.pipeline.learning import ModelJob, train_model
from nas_data.experiments.pipeline.material import PHI
from nas_data.models.holding_out import rows_of
from nas_data.models.presets import TrainingOptions
from nas_data.policies.compare import Record, Run, do_run, silence
from nas_data.policies.learner import Hyperparameters, Training


@dataclass(frozen=True)
class CountJob:
    """A number of trajectories and a seed.

    Attributes:
        count: Trajectories that φ learns from.
        seed: Of the subset, of φ and of the policy.
        pairs: Folder of all pairs; of two counts of one seed, the smaller's subset is part of the larger's.
        content_hash: Theirs.
        options: Of φ's training.
        source: The source.
        target: What judges.
        frames: Control steps of the policy.
        episodes: Episodes that it is judged on.
        hyperparameters: PPO's.
        policies: Folder of policies of this length and PPO.
        folder: Where φ and the policy go.
        threads: Threads that simulate φ's source; all cores where None.
    """

    count: int
    seed: int
    pairs: Path
    content_hash: str
    options: TrainingOptions
    source: Plant
    target: Plant
    frames: int
    episodes: int
    hyperparameters: Hyperparameters
    policies: str
    folder: Path
    threads: int | None = None

    def subset(self, dataset: Dataset) -> Dataset:
        """Return the trajectories that φ learns from."""
        runs = draw(dataset, range(dataset.n_episodes), Amount(self.count, "episodes"), self.seed)
        return rows_of(dataset, runs)


def do_count(job: CountJob) -> Record:
    """Train φ and then the policy, judge it on the target; what was done before is read.

    Returns:
        The policy's record, and `phi_seconds`, the time in which φ was trained [s].
    """
    model = ModelJob("delta", job.pairs, replace(job.options, seed=job.seed), job.folder / PHI, job.threads)
    history = train_model(model, silence, job.subset)
    plant = replace(job.source, checkpoint=str(model.folder))
    run = Run(
        method="nas",
        training=Training(plant, job.seed, job.frames, job.hyperparameters),
        target=job.target,
        episodes=job.episodes,
        folder=job.folder / "policy" / job.policies,
        quiet=True,
        dataset=job.content_hash,
    )
    return {**do_run(run), "phi_seconds": history[-1]["seconds"]}
