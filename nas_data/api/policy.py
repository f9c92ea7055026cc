"""A trained policy as stable-baselines3's PPO, with the environment's own observations and actions."""

from pathlib import Path

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecEnv

from nas_data.arrays import Array
from nas_data.count_of import count_of
from nas_data.environment_ids import make_environment_id
from nas_data.envs.base import find_task_file
from nas_data.errors import CheckpointError, JointMismatch, OptionError
from nas_data.policies.policy import CLIP, EPSILON, MEAN, VARIANCE, Policy, find_policies
from nas_data.policies.policy import load_policy as read_policy
from nas_data.policies.ppo import make_ppo

EXTRACTOR = "features_extractor"  # suffix of the names of the normalising modules; actor and critic share one


class Normalise(BaseFeaturesExtractor):
    """Observations normalised by the frozen statistics of a training, as by its `VecNormalize`."""

    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, observation_space: gymnasium.spaces.Box) -> None:
        """Initialise to the identity: mean 0, scale 1."""
        super().__init__(observation_space, int(np.prod(observation_space.shape)))
        self.register_buffer("mean", torch.zeros(self.features_dim, dtype=torch.float64))
        self.register_buffer("scale", torch.ones(self.features_dim, dtype=torch.float64))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return normalised observations (B, o), float32, for raw ones (B, o)."""
        return torch.clip((observations - self.mean) / self.scale, -CLIP, CLIP).float()


def load_policy(
    folder: str | Path, *, seed: int | None = None, env: gymnasium.Env[Array, Array] | VecEnv | None = None
) -> PPO:
    """Read a policy folder as stable-baselines3's PPO.

    It acts on the environment's unnormalised observations: `action, _ = ppo.predict(observation, deterministic=True)`.
    It contains the normalisation of its training, so `ppo.save` and `PPO.load` preserve it. `ppo.learn` continues from
    these weights with a new optimiser and the unnormalised rewards of `env`.

    Args:
        folder: Folder written by `nas policy train`: a policy, or the parent of several seeds.
        seed: Seed of the policy, if there are several.
        env: Environment for further training; None for its own environment on the plain source.

    Raises:
        CheckpointError: there is no policy, or it is damaged.
        OptionError: there are several, or none of that seed.
        JointMismatch: the environment has other observations or actions.
    """
    policy = choose(Path(folder), seed)
    settings = policy.config.hyperparameters
    if settings is None:
        raise CheckpointError(f"{folder} lacks the training configuration of its policy; train it again.")
    env = env or gymnasium.make(f"nas_data:{make_environment_id(find_task_file(policy.environment))}")
    check_spaces(policy, env)
    options = {"features_extractor_class": Normalise, "optimizer_kwargs": {"eps": 1e-5}}
    ppo = make_ppo(ActorCriticPolicy, env, settings, policy.seed, options)
    fill(ppo, policy, Path(folder))
    ppo.num_timesteps = policy.frames
    return ppo


def choose(folder: Path, seed: int | None) -> Policy:
    """Return the policy of a folder; `seed` selects one of several.

    Raises:
        CheckpointError: there is none.
        OptionError: there are several, or none of that seed.
    """
    policies = [read_policy(path) for path in find_policies(folder)]
    found = [policy for policy in policies if seed in (None, policy.seed)]
    if len(found) != 1:
        seeds = ", ".join(str(policy.seed) for policy in policies)
        raise OptionError(
            f"{folder} holds the policies of the seeds {seeds}; give one of them: seed={policies[0].seed}."
        )
    return found[0]


def check_spaces(policy: Policy, env: gymnasium.Env[Array, Array] | VecEnv) -> None:
    """Refuse an environment with other observation or action sizes than the policy's.

    Raises:
        JointMismatch: names the space and both sizes.
    """
    wanted = len(policy.tensors[MEAN]), len(policy.tensors["action_net.bias"])
    shapes = env.observation_space.shape, env.action_space.shape
    if shapes != ((wanted[0],), (wanted[1],)):
        raise JointMismatch(
            f"The policy needs an observation of {count_of(wanted[0], 'number')} and an action of {wanted[1]}; the "
            f"environment has {shapes[0]} and {shapes[1]}. Give a {policy.environment}."
        )


def fill(ppo: PPO, policy: Policy, folder: Path) -> None:
    """Copy a policy's weights and statistics into PPO's networks.

    Raises:
        CheckpointError: weights are missing or have another shape.
    """
    normalise = ppo.policy.features_extractor
    assert isinstance(normalise, Normalise)
    normalise.mean.copy_(torch.from_numpy(policy.tensors[MEAN]))
    normalise.scale.copy_(torch.from_numpy(np.sqrt(policy.tensors[VARIANCE] + EPSILON)))
    held = {name: torch.from_numpy(array) for name, array in policy.tensors.items() if name not in (MEAN, VARIANCE)}
    own = {name: tensor for name, tensor in ppo.policy.state_dict().items() if EXTRACTOR in name}
    try:
        ppo.policy.load_state_dict({**own, **held})
    except RuntimeError as error:
        raise CheckpointError(
            f"{folder} has networks that do not match its configuration ({error}); train the policy again."
        ) from None
