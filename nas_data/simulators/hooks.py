"""Batches of simulations whose hooks set friction between physics steps, for effects that MuJoCo cannot express."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import mujoco.batch
import numpy as np

from nas_data.effects.base import Effect
from nas_data.effects.edits.hook import StepForces, StepHook

MULTITHREAD_SIZE = 64  # batch size from which a second thread pays off


def find_hooks(effects: Iterable[Effect], model: mujoco.MjModel) -> tuple[StepHook, ...]:
    """Return one hook for each type of effect that needs one; `model` is compiled with the effects."""
    kinds: dict[type[Effect], list[Effect]] = {}
    for effect in effects:
        if not effect.is_neutral:
            kinds.setdefault(type(effect), []).append(effect)
    hooks = (kind.hook(members, model) for kind, members in kinds.items())
    return tuple(hook for hook in hooks if hook is not None)


@dataclass(frozen=True)
class ServoShutdown:
    """The control step after which the servos of each simulation are switched off.

    Attributes:
        disabled_before: `opt.disableactuator` while the servos are on.
        steps: Control steps until the shutdown, shape (B,).
    """

    disabled_before: int
    steps: np.ndarray


class HookedBatch:
    """A batch of simulations in which hooks set the friction before each physics step.

    Attributes:
        released: Whether the servos are switched off, shape (B,); the hooks read it.
    """

    def __init__(self, batch: mujoco.batch.Batch, hooks: Sequence[StepHook]) -> None:
        """Bind the hooks to the forces of a batch."""
        self._batch = batch
        self._own = np.tile(batch.model.dof_frictionloss, (batch.nsim, 1))
        self._friction = batch.expand("dof_frictionloss")
        self._warm = batch.bind("qacc_warmstart")
        self.released = np.zeros(batch.nsim, bool)
        force, bias, velocity = (batch.bind(name) for name in ("actuator_force", "qfrc_bias", "qvel"))
        forces = StepForces(force, bias, velocity, self.released)
        self._hooks = [hook(forces) for hook in hooks]

    def refresh(self, rows: np.ndarray | None = None) -> None:
        """Compute the actuator forces after states were set; for all simulations if rows is None."""
        self._batch.forward(None if rows is None else np.unique(rows))
        self._warm[slice(None) if rows is None else rows] = 0.0  # no warm start in a new state

    def step(self, count: int) -> None:
        """Advance all simulations by `count` physics steps."""
        for _ in range(count):
            friction = self._own
            for hook in self._hooks:
                friction = np.add(friction, hook(), out=self._friction)
            self._batch.step()


def roll_out_with_hooks(
    model: mujoco.MjModel,
    hooks: Sequence[StepHook],
    states: np.ndarray,
    controls: np.ndarray,
    substeps: int,
    threads: int,
    shutdown: ServoShutdown | None = None,
) -> np.ndarray:
    """Roll out simulations as one batch.

    Args:
        model: Compiled model; with a shutdown, the one whose servos are disabled.
        hooks: Hooks of the effects.
        states: First full states, shape (B, size of INTEGRATION).
        controls: Controls, each held for `substeps`, shape (B, T, nu).
        substeps: Physics steps per control step.
        threads: Threads of the batch.
        shutdown: When the servos are switched off; never if None.

    Returns:
        Time [s], qpos and qvel after each control step, shape (B, T, 1 + nq + nv).
    """
    # waking a second thread in each physics step costs more than it saves in small batches
    batch = mujoco.batch.Batch(model, nsim=len(states), nthread=threads if len(states) >= MULTITHREAD_SIZE else 1)
    hooked = HookedBatch(batch, hooks)
    control = batch.bind("ctrl")
    disabled = batch.expand("opt.disableactuator") if shutdown else None
    batch.state[:] = states
    hooked.released[:] = switch_off_servos(disabled, model, shutdown, 0)
    hooked.refresh()
    ends = np.empty((*controls.shape[:2], 1 + model.nq + model.nv))
    for step in range(controls.shape[1]):
        control[:] = controls[:, step]
        hooked.released[:] = switch_off_servos(disabled, model, shutdown, step)
        hooked.step(substeps)
        ends[:, step] = batch.state[:, : ends.shape[2]]
    return ends


def switch_off_servos(
    disabled: np.ndarray | None, model: mujoco.MjModel, shutdown: ServoShutdown | None, step: int
) -> np.ndarray | bool:
    """Switch off the servos of simulations whose shutdown is due.

    Returns:
        Which simulations are switched off, shape (B,); False without a shutdown.
    """
    if disabled is None or shutdown is None:
        return False
    off = shutdown.steps <= step
    disabled[:] = np.where(off, model.opt.disableactuator, shutdown.disabled_before).reshape(disabled.shape)
    return off
