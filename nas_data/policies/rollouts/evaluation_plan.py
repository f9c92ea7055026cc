"""Plan of an evaluation on an arm: policies, starts and their order."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.policies.evaluate import SEED, Group, Returns, check_fits
from nas_data.policies.policy import WEIGHTS, Policy, find_policies, load_policy


@dataclass(frozen=True)
class EvaluationPlan:
    """Plan in which every policy plays the same starts, policy by policy."""

    paths: tuple[Path, ...]  # folders that the user gave, each with one policy or one per seed
    folders: tuple[tuple[Path, ...], ...]  # folders of the policies, for each path
    policies: dict[Path, Policy]  # policies by folder
    episodes: int  # number of episodes of each policy

    @classmethod
    def of(cls, paths: Sequence[Path], environment: str, episodes: int) -> "EvaluationPlan":
        """Read policies.

        Args:
            paths: Folders of policies.
            environment: Environment of the evaluation.
            episodes: Number of episodes of each policy.

        Raises:
            CheckpointError: there are no policies, or they were trained for another environment.
        """
        folders = tuple(tuple(find_policies(path)) for path in paths)
        policies = {folder: load_policy(folder) for found in folders for folder in found}
        for policy in policies.values():
            check_fits(policy, environment)
        return cls(tuple(paths), folders, policies, episodes)

    def turns(self) -> list[tuple[Policy, int]]:
        """Return the policy and the start seed of each episode; seeds are the same as in simulation."""
        listed = [folder for found in self.folders for folder in found]
        return [(self.policies[folder], SEED + number) for folder in listed for number in range(self.episodes)]

    def weights(self) -> list[str]:
        """Return the SHA-256 of each policy's weights, in playing order."""
        files = [folder / WEIGHTS for found in self.folders for folder in found]
        return [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]

    def groups(self, scores: Sequence[Returns]) -> list[Group]:
        """Group the scores of all episodes by the folders that the user gave."""
        left = iter(scores)
        groups = []
        for path, found in zip(self.paths, self.folders, strict=True):
            of_each = [concatenate_scores([next(left) for _ in range(self.episodes)]) for _ in found]
            groups.append(Group(str(path), found, [self.policies[folder] for folder in found], of_each))
        return groups


def concatenate_scores(scores: Sequence[Returns]) -> Returns:
    """Concatenate the scores of episodes."""
    return Returns(
        returns=np.concatenate([score.returns for score in scores]),
        successes=np.concatenate([score.successes for score in scores]),
        lengths=np.concatenate([score.lengths for score in scores]),
        diverged=np.concatenate([score.diverged for score in scores]),
    )
