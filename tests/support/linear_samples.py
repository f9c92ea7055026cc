"""Linear arms, and networks that say nothing or know the whole difference between two of them."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
import torch
from torch import nn

from nas_data.dataset.features import EFFORT, POSITION, Feature
from nas_data.models.lstm import DynamicsModel
from nas_data.models.predictions import StaticStepper


def network(kind="delta", joints=("m1", "m2"), seed=0, **options) -> DynamicsModel:
    """Return a small random network with a normalisation that is not neutral."""
    torch.manual_seed(seed)
    model = DynamicsModel(kind, joints, hidden=options.pop("hidden", 8), **options)
    for name in ("input", "output"):
        mean, std = model.get_buffer(f"{name}_mean"), model.get_buffer(f"{name}_std")
        mean.copy_(0.1 * torch.randn(len(mean)))
        std.copy_(0.2 + torch.rand(len(std)))
    return model.eval().requires_grad_(False)


def silent(model: DynamicsModel) -> DynamicsModel:
    """Make a model predict no change at all."""
    parts = [model.outer] + ([model.shortcut] if model.shortcut is not None else [])
    for part in parts:
        nn.init.zeros_(part.weight)
        nn.init.zeros_(part.bias)
    model.get_buffer("output_mean").zero_()
    return model


def draw(model: DynamicsModel, batch: int, steps: int, seed=0) -> list[torch.Tensor]:
    """Return states, commands and predictions, shape (batch, steps, …)."""
    generator = torch.Generator().manual_seed(seed)
    n = len(model.joints)
    return [torch.randn(batch, steps, width, generator=generator) for width in (2 * n, n, 2 * n)]


class LinearStepper(StaticStepper):
    """A batch of linear arms."""

    def __init__(self, simulator: "LinearSimulator", size: int) -> None:
        super().__init__(simulator.joints, size)
        self.simulator = simulator

    def step(self, commands: np.ndarray) -> np.ndarray:
        self.set_states(self.simulator.predict(self.states, commands))
        return self.states


@dataclass
class LinearSimulator:
    """A test double: n joints that follow their commands, a little coupled; next state = a state + b command."""

    joints: tuple[str, ...]
    a: np.ndarray
    b: np.ndarray
    period: float = 0.02
    slides: tuple[str, ...] = ()
    commands_effort: bool = False
    remembers: bool = False
    object_feature: Feature = field(default_factory=lambda: Feature(names=()))

    @classmethod
    def draw(cls, seed: int, joints: tuple[str, ...] = ("m1", "m2")) -> Self:
        """Return an arm of random stiffness, damping and coupling."""
        rng = np.random.default_rng(seed)
        n, one = len(joints), np.eye(len(joints))
        stiffness, damping = np.diag(rng.uniform(20, 60, n)), np.diag(rng.uniform(6, 12, n))
        coupling = rng.normal(scale=0.5, size=(n, n))
        # v' = v + h (k (c − q) − d v), q' = q + h v'
        speed = np.concatenate([-0.02 * (stiffness + coupling), one - 0.02 * damping], axis=1)
        position = np.eye(n, 2 * n) + 0.02 * speed
        return cls(
            joints,
            a=np.concatenate([position, speed]),
            b=0.02 * np.concatenate([0.02 * stiffness, stiffness]),
        )

    @property
    def kinds(self) -> tuple[str, ...]:
        return (EFFORT if self.commands_effort else POSITION,) * len(self.joints)

    def predict(self, states: np.ndarray, commands: np.ndarray, continues: np.ndarray | None = None) -> np.ndarray:
        return states @ self.a.T + commands @ self.b.T

    def rollout(self, initial: np.ndarray, commands: np.ndarray) -> np.ndarray:
        states, after = initial, []
        for step in range(commands.shape[1]):
            states = self.predict(states, commands[:, step])
            after.append(states)
        return np.stack(after, axis=1)

    def rollout_settled(
        self, initial: np.ndarray, commands: np.ndarray, initial_loads: np.ndarray | None = None
    ) -> np.ndarray:
        return self.rollout(initial, commands)

    def stepper(self, size: int) -> LinearStepper:
        return LinearStepper(self, size)

    def describe(self) -> dict[str, object]:
        return {"name": "linear", "engine": "numpy"}


def knows(model: DynamicsModel, source: LinearSimulator, target: LinearSimulator) -> DynamicsModel:
    """Give a model, by its shortcut alone, the linear map from what it reads to what the target does otherwise."""
    n = len(model.joints)
    base = (source.a, source.b) if model.kind == "delta" else (np.eye(2 * n), np.zeros((2 * n, n)))
    from_state, from_command = target.a - base[0], target.b - base[1]
    if model.relative:  # reads command − position
        from_state = from_state + from_command @ np.eye(n, 2 * n)
    unused = np.zeros((2 * n, 2 * n if model.kind == "delta" else 0))
    weight = np.concatenate([from_state, from_command, unused], axis=1)
    (input_mean, input_std), (output_mean, output_std) = (
        [model.get_buffer(f"{name}_{kind}").double().numpy() for kind in ("mean", "std")]
        for name in ("input", "output")
    )
    silent(model)
    model.get_buffer("output_mean").copy_(torch.from_numpy(output_mean))
    assert model.shortcut is not None
    with torch.no_grad():
        model.shortcut.weight.copy_(torch.from_numpy(weight * input_std / output_std[:, None]))
        model.shortcut.bias.copy_(torch.from_numpy((weight @ input_mean - output_mean) / output_std))
    return model
