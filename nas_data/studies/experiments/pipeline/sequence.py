"""Predictions of held-out episodes by φ, ψ and baselines, and the choice of an episode to draw."""

from dataclasses import dataclass

import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.features import POSITION
from nas_data.dataset.read import read
from nas_data.joint_units import find_joint_unit
from nas_data.models.evaluation import Evaluation
from nas_data.reports.figures import compute_joint_errors, draw_trajectory, warn
from nas_data.reports.style import to_png
from nas_data.studies.experiments.base import Request
from nas_data.studies.experiments.pipeline.artifacts import PHI, PSI, Artifacts
from nas_data.studies.experiments.pipeline.learning import compare_models
from nas_data.studies.experiments.pipeline.stages import describe_stages

NEEDS = ("record", PHI, PSI)
DRAWN = ("source + φ", "ψ", "source", "hold")


@dataclass(frozen=True)
class Sequence:
    """Held-out episodes with predictions, and the episode to draw."""

    material: Artifacts  # their artifacts
    dataset: Dataset  # the episodes
    evaluation: Evaluation  # predictions and errors
    episode: int  # the drawn episode: the one with the median source error among those of the paper's protocol
    joint: int  # the joint with the largest source error in these episodes

    @property
    def measured(self) -> list[np.ndarray]:
        """Measured states after each command, one array of shape (T, 2n) per episode."""
        return [self.dataset.next_states[rows] for rows in self.dataset.episodes()]

    def errors(self, predictor: str) -> list[np.ndarray]:
        """Return the RMS position error over joints [rad] at each step, one array of shape (T,) per episode."""
        joints, rollouts = len(self.dataset.joints), self.evaluation.rollouts[predictor]
        return [compute_joint_errors(one, other, joints) for one, other in zip(rollouts, self.measured, strict=True)]

    def picture(self, quick: bool) -> bytes:
        """Draw the joint in the episode, and the predictors' errors below; a quick run is marked as no result."""
        rows = self.dataset.episode(self.episode)
        commanded = self.dataset.kinds[self.joint] == POSITION
        figure = draw_trajectory(
            self.measured[self.episode][:, self.joint],
            {name: self.evaluation.rollouts[name][self.episode][:, self.joint] for name in DRAWN},
            self.dataset.commands[rows, self.joint] if commanded else None,
            1 / self.dataset.fps,
            self.dataset.joints[self.joint],
            find_joint_unit(self.dataset.joints[self.joint], self.dataset.slides),
        )
        warn(figure, quick)
        return to_png(figure)

    def describe(self) -> dict[str, object]:
        """Return the drawn episode for JSON: positions [rad] of all joints, by predictor."""
        joints = len(self.dataset.joints)
        curves = {"measured": self.measured, **{name: self.evaluation.rollouts[name] for name in DRAWN}}
        return {
            "environment": self.material.plan.recipe.environment,
            "episode": self.episode,
            "joint": self.dataset.joints[self.joint],
            "joints": list(self.dataset.joints),
            "commands": self.dataset.commands[self.dataset.episode(self.episode)].tolist(),
            "positions": {name: values[self.episode][:, :joints].tolist() for name, values in curves.items()},
            "dataset": self.material.content_hash,
            "heldout": self.dataset.n_episodes,
            "material": self.material.plan.describe(),
            "stages": describe_stages(self.material),
        }


def predict_heldout(request: Request, environment: str) -> Sequence:
    """Build the required artifacts, predict the held-out episodes in open loop, and choose one to draw."""
    material = request.material(environment, NEEDS)
    dataset = read(material.heldout)
    request.report(f"rolling out {dataset.n_episodes} held-out episodes")
    evaluation = compare_models(dataset, material.simulator(), material.folder / PHI, material.folder / PSI)
    protocol = np.array(material.paper_protocol())
    squared = evaluation.open_loop["source"].squared[protocol]  # [rad²], shape (episodes, joints)
    wrong = squared.mean(axis=1)
    episode = int(protocol[np.argsort(wrong, kind="stable")[len(wrong) // 2]])
    return Sequence(material, dataset, evaluation, episode, int(squared.mean(axis=0).argmax()))
