"""Effects that the engine lacks, at work between the physics steps of a whole batch."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import mujoco.batch
import numpy as np

from nas_data.effects.base import Effect
from nas_data.effects.edits.hook import StepForces, StepHook

WORTH_THREADS = 64  # simulations from which a second thread pays off


def find_hooks(effects: Iterable[Effect], model: mujoco.MjModel) -> tuple[StepHook, ...]:
    """Return the hooks of those effects that need one, one for each kind, for the model with the effects in it."""
    kinds: dict[type[Effect], list[Effect]] = {}
    for effect in effects:
        if not effect.is_neutral:
            kinds.setdefault(type(effect), []).append(effect)
    hooks = (kind.hook(alike, model) for kind, alike in kinds.items())
    return tuple(hook for hook in hooks if hook is not None)


@dataclass(frozen=True)
class Switching:
    """When the servos of each simulation are switched off.

    Attributes:
        powered: What the model disables while they are on, as `opt.disableactuator` does.
        driven: Control steps until then, shape (B,).
    """

    powered: int
    driven: np.ndarray


class HookedBatch:
    """A batch of simulations whose friction hooks set before each physics step."""

    def __init__(self, batch: mujoco.batch.Batch, hooks: Sequence[StepHook]) -> None:
        """Bind the forces of a batch."""
        self._batch = batch
        self._own = np.tile(batch.model.dof_frictionloss, (batch.nsim, 1))
        self._friction = batch.expand("dof_frictionloss")
        self._warm = batch.bind("qacc_warmstart")
        self.released = np.zeros(batch.nsim, bool)
        forces = StepForces(batch.bind("actuator_force"), batch.bind("qfrc_bias"), self.released)
        self._hooks = [hook(forces) for hook in hooks]

    def refresh(self, rows: np.ndarray | None = None) -> None:
        """Compute the actuators' forces in states that were just set; all simulations where rows is None."""
        self._batch.forward(None if rows is None else np.unique(rows))
        self._warm[slice(None) if rows is None else rows] = 0.0  # where a state was set, nothing warms the solver

    def step(self, count: int) -> None:
        """Advance all simulations by `count` physics steps."""
        for _ in range(count):
            friction = self._own
            for hook in self._hooks:
                friction = np.add(friction, hook(), out=self._friction)
            self._batch.step()


def roll_hooked(
    model: mujoco.MjModel,
    hooks: Sequence[StepHook],
    states: np.ndarray,
    controls: np.ndarray,
    substeps: int,
    threads: int,
    switching: Switching | None = None,
) -> np.ndarray:
    """Roll out simulations as one batch.

    Args:
        model: Compiled model; where servos are switched off, the one in which they are.
        hooks: What runs between the steps.
        states: First full states, shape (B, size of INTEGRATION).
        controls: Shape (B, T, nu), each held for `substeps`.
        substeps: Physics steps per control step.
        threads: Threads of the batch.
        switching: When servos are switched off; never where None.

    Returns:
        Time [s], qpos and qvel after each control step, shape (B, T, 1 + nq + nv).
    """
    # waking a second thread each physics step costs more than it saves unless it has much to do
    batch = mujoco.batch.Batch(model, nsim=len(states), nthread=threads if len(states) >= WORTH_THREADS else 1)
    hooked = HookedBatch(batch, hooks)
    control = batch.bind("ctrl")
    disabled = batch.expand("opt.disableactuator") if switching else None
    batch.state[:] = states
    hooked.released[:] = switch(disabled, model, switching, 0)
    hooked.refresh()
    ends = np.empty((*controls.shape[:2], 1 + model.nq + model.nv))
    for step in range(controls.shape[1]):
        control[:] = controls[:, step]
        hooked.released[:] = switch(disabled, model, switching, step)
        hooked.step(substeps)
        ends[:, step] = batch.state[:, : ends.shape[2]]
    return ends


def switch(
    disabled: np.ndarray | None, model: mujoco.MjModel, switching: Switching | None, step: int
) -> np.ndarray | bool:
    """Switch off the servos of those simulations in a batch whose time has come; return which, shape (B,), or False."""
    if disabled is None or switching is None:
        return False
    off = switching.driven <= step
    disabled[:] = np.where(off, model.opt.disableactuator, switching.powered).reshape(disabled.shape)
    return off
