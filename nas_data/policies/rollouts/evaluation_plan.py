"""What is to be rolled out on an arm: which policies, from which starts, in which order."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.policies.evaluate import SEED, Group, Returns, check_fits
from nas_data.policies.policy import WEIGHTS, Policy, find_policies, load_policy


@dataclass(frozen=True)
class EvaluationPlan:
    """Every policy from the same starts, one episode after the other, one policy after the other.

    Attributes:
        paths: Folders as the user gave them: of one policy, or of one a seed.
        folders: Policies' folders, path by path.
        policies: By folder.
        episodes: Of each policy.
    """

    paths: tuple[Path, ...]
    folders: tuple[tuple[Path, ...], ...]
    policies: dict[Path, Policy]
    episodes: int

    @classmethod
    def of(cls, paths: Sequence[Path], environment: str, episodes: int) -> "EvaluationPlan":
        """Read policies.

        Args:
            paths: Where they lie.
            environment: What they are to be judged on.
            episodes: Of each policy.

        Raises:
            CheckpointError: there are none, or they were trained for something else.
        """
        folders = tuple(tuple(find_policies(path)) for path in paths)
        policies = {folder: load_policy(folder) for found in folders for folder in found}
        for policy in policies.values():
            check_fits(policy, environment)
        return cls(tuple(paths), folders, policies, episodes)

    def turns(self) -> list[tuple[Policy, int]]:
        """Return who acts in each episode, and the seed of its start: that which it has in simulation."""
        listed = [folder for found in self.folders for folder in found]
        return [(self.policies[folder], SEED + number) for folder in listed for number in range(self.episodes)]

    def weights(self) -> list[str]:
        """Return the SHA-256 of each policy's weights, in the order of their turns."""
        files = [folder / WEIGHTS for found in self.folders for folder in found]
        return [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]

    def groups(self, scores: Sequence[Returns]) -> list[Group]:
        """Return the scores of all turns by the folders that the user gave."""
        left = iter(scores)
        groups = []
        for path, found in zip(self.paths, self.folders, strict=True):
            of_each = [together([next(left) for _ in range(self.episodes)]) for _ in found]
            groups.append(Group(str(path), found, [self.policies[folder] for folder in found], of_each))
        return groups


def together(scores: Sequence[Returns]) -> Returns:
    """Return episodes that went one after the other as one score."""
    return Returns(
        returns=np.concatenate([score.returns for score in scores]),
        successes=np.concatenate([score.successes for score in scores]),
        lengths=np.concatenate([score.lengths for score in scores]),
        diverged=np.concatenate([score.diverged for score in scores]),
    )
