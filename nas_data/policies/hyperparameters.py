"""Hyperparameters of the paper's PPO."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Hyperparameters:
    """Hyperparameters of the paper's PPO; 16 arms share a rollout of its robot experiments (4 processes × 2048 steps).

    Attributes:
        arms: Simulations stepped together.
        rollout: Frames between two updates, over all arms.
        minibatches: Parts of a rollout, one gradient step each.
        epochs: Passes over a rollout.
        learning_rate: Learning rate of Adam.
        discount: γ.
        trace: λ of the advantage estimate.
        clip: Largest change of an action's probability ratio.
        entropy_weight: Weight of the entropy in the loss.
        value_weight: Weight of the value error in the loss.
        gradient_norm: Largest norm of a gradient.
        hidden: Widths of the tanh layers, separate for actor and critic.
    """

    arms: int = 16
    rollout: int = 8192
    minibatches: int = 32
    epochs: int = 10
    learning_rate: float = 3e-4
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    entropy_weight: float = 0.0
    value_weight: float = 0.5
    gradient_norm: float = 0.5
    hidden: tuple[int, ...] = (64, 64)
