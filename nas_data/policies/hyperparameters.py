"""Hyperparameters of the paper's PPO."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Hyperparameters:
    """The paper's PPO; 16 arms share a rollout of its robot experiments (4 processes × 2048 steps)."""

    arms: int = 16  # simulations stepped together
    rollout: int = 8192  # frames between two updates, over all arms
    minibatches: int = 32  # parts of a rollout, one gradient step each
    epochs: int = 10  # passes over a rollout
    learning_rate: float = 3e-4  # learning rate of Adam
    discount: float = 0.99  # γ
    trace: float = 0.95  # λ of the advantage estimate
    clip: float = 0.2  # largest change of an action's probability ratio
    entropy_weight: float = 0.0  # weight of the entropy in the loss
    value_weight: float = 0.5  # weight of the value error in the loss
    gradient_norm: float = 0.5  # largest norm of a gradient
    hidden: tuple[int, ...] = (64, 64)  # widths of the tanh layers, separate for actor and critic
