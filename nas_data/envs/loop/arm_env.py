"""A task as a Gymnasium environment of one arm."""

from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium
import gymnasium.utils
import numpy as np

from nas_data.arrays import Array
from nas_data.envs.base import SOURCE
from nas_data.envs.loop.dynamics_spec import DynamicsSpec
from nas_data.envs.loop.task_batch import TaskBatch
from nas_data.errors import OptionError
from nas_data.simulators.base import Stepper

if TYPE_CHECKING:
    from nas_data.envs.loop.rendering import Pose, Window
    from nas_data.simulators.offscreen import OffscreenRenderer

HUMAN, RGB_ARRAY = "human", "rgb_array"


class ArmEnv(gymnasium.Env[Array, Array], gymnasium.utils.EzPickle):
    """A task as a Gymnasium environment; the same logic as `ArmVecEnv`, for one arm.

    Pickling and copying rebuild it from its arguments; the copy needs a `reset` first.

    Example:
        >>> import gymnasium
        >>> env = gymnasium.make("nas_data:nas/ErgoReacher-v0", dynamics="backlash")
        >>> observation, info = env.reset(seed=0)
        >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    """

    metadata = {"render_modes": [HUMAN, RGB_ARRAY]}  # noqa: RUF012 (Gymnasium's base class declares no ClassVar)

    def __init__(
        self,
        task: str,
        dynamics: str = SOURCE,
        checkpoint: str | Path | None = None,
        stepper: Stepper | None = None,
        render_mode: str | None = None,
        effects: str | Path | None = None,
        engine: str = "mujoco",
        missed: float = 0.0,
    ) -> None:
        """Build the environment.

        Args:
            task: Name of the task.
            dynamics: Name of one of the task's dynamics; `source` is the plain model.
            checkpoint: Learned model that corrects (φ) or replaces (ψ) the physics.
            stepper: Stepper of batch size 1 that replaces the simulation of the task's robot.
            render_mode: `rgb_array`: `render()` returns a picture; `human`: a window shows every step as it happens.
            effects: Gap report, or its `effects.json`; its named effects are added to the physics.
            engine: Physics engine, `mujoco` or `bullet`.
            missed: Share of touches that ErgoShield does not detect.

        Raises:
            UnknownName: there is no such task, dynamics or engine; lists the choices.
            OptionError: there is no such render mode.
        """
        if render_mode not in (None, HUMAN, RGB_ARRAY):
            raise OptionError(f"render_mode is '{render_mode}'; choose '{RGB_ARRAY}', '{HUMAN}' or None.")
        gymnasium.utils.EzPickle.__init__(
            self, task, dynamics, checkpoint, stepper, render_mode, effects, engine, missed
        )
        model, named = (None if file is None else str(file) for file in (checkpoint, effects))
        plant = DynamicsSpec(task, dynamics, model, named, engine, missed)
        self.task = plant.task
        self.arena = TaskBatch(self.task, stepper or plant.stepper(1))
        self.observation_space = self.task.observation_space
        self.action_space = self.task.action_space
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / self.task.period)}
        self._dynamics = dynamics
        self._pose: Pose | None = None
        self._display: OffscreenRenderer | Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[Array, dict[str, object]]:
        """Begin an episode; return its first observation."""
        super().reset(seed=seed)
        self.arena.start([self.np_random])
        self._seen = self.arena.observe()[0]
        if self.render_mode == HUMAN:
            self.render()
        return self._seen.copy(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, object]]:
        """Act for one control period; `info["is_success"]` is whether the goal was reached in this episode.

        A simulation that diverges ends the episode (see `TaskBatch`). Then `info["diverged"]` is true, and the
        observation is the previous one.

        Raises:
            OptionError: the action is not finite or has another shape than the action space.
        """
        verdict, truncated = self.arena.step(np.asarray(action)[None])
        diverged = bool(self.arena.lost[0])
        info: dict[str, object] = {"is_success": bool(self.arena.succeeded[0]), "diverged": diverged}
        self._seen = self._seen if diverged else self.arena.observe()[0]
        if self.render_mode == HUMAN:
            self.render()
        return self._seen.copy(), float(verdict.reward[0]), bool(verdict.terminated[0]), bool(truncated[0]), info

    def render(self) -> Array | None:
        """Return an image of the arm, shape (480, 640, 3), uint8; with `human`, show it and return None.

        Raises:
            OptionError: the environment was made without a render mode, or there is no screen for a window.
            MissingPackage: this machine has no renderer; the message names a package.
        """
        from nas_data.envs.loop.rendering import Pose, Window
        from nas_data.simulators.offscreen import OffscreenRenderer

        if self.render_mode is None:
            raise OptionError(f"The environment was made without pictures; make it with render_mode='{RGB_ARRAY}'.")
        if self._pose is None:
            self._pose = Pose(self.task, self._dynamics)
        if self._display is None:
            human = self.render_mode == HUMAN
            pose = self._pose
            self._display = Window(pose, self.task.period) if human else OffscreenRenderer(pose.model, pose.data)
        self._pose.take(self.arena.stepper)
        if isinstance(self._display, OffscreenRenderer):
            return self._display.draw()
        self._display.show()
        return None

    def close(self) -> None:
        """Close the window or the renderer, if one is open."""
        if self._display is not None:
            self._display.close()
            self._display = None
