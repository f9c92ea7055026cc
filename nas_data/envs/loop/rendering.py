"""Rendering of environments: images of the present pose, and a window that follows it."""

import os
import sys
import time

import mujoco
import mujoco.viewer
import numpy as np

from nas_data.envs.base import Task
from nas_data.envs.loop.arm_env import HUMAN, RGB_ARRAY
from nas_data.errors import OptionError
from nas_data.simulators.base import Stepper
from nas_data.simulators.layout import FULLPHYSICS, Layout
from nas_data.simulators.rest_states import RestStates


class Pose:
    """The model of a task in the pose of a simulation, network or robot; it runs no physics."""

    def __init__(self, task: Task, dynamics: str) -> None:
        """Compile the model of a task's dynamics, without effects, which are invisible."""
        robot, _ = task.body(dynamics)
        self.model = robot.spec().compile()
        self.data = mujoco.MjData(self.model)
        self._rest = RestStates(self.model, Layout.of(self.model, task.joints, str(robot.mjcf)), FULLPHYSICS)

    def take(self, stepper: Stepper) -> None:
        """Take the pose of the first simulation; keep the last one if it has diverged."""
        states = np.concatenate([stepper.states[:1], stepper.objects[:1]], axis=1)
        if not np.isfinite(states).all():
            return
        positions, _ = self._rest.motion(self._rest(states))
        self.data.qpos[:] = positions[0]
        mujoco.mj_forward(self.model, self.data)


class Window:
    """A window that shows a pose in real time."""

    def __init__(self, pose: Pose, period: float) -> None:
        """Open the window.

        Args:
            pose: The pose to show.
            period: Time between two frames [s]; a faster simulation waits.

        Raises:
            OptionError: there is no screen.
        """
        if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise OptionError(f"render_mode='{HUMAN}' needs a screen, and there is none; use '{RGB_ARRAY}'.")
        self._period, self._due = period, time.monotonic()
        self._viewer = mujoco.viewer.launch_passive(pose.model, pose.data, show_left_ui=False, show_right_ui=False)

    def show(self) -> None:
        """Wait until the next frame is due, and show the pose."""
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = time.monotonic() + self._period
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()
