"""What an environment looks like: the posture that a simulation tells of, and a window that follows it."""

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
from nas_data.simulators.layout import FULLPHYSICS, Layout, RestStates


class Pose:
    """The model of a task in the posture that a simulation, a network or a robot tells of; its physics never runs."""

    def __init__(self, task: Task, dynamics: str) -> None:
        """Compile the model of a task's dynamics, without effects: they move the arm, and nobody sees them."""
        robot, _ = task.body(dynamics)
        self.model = robot.spec().compile()
        self.data = mujoco.MjData(self.model)
        self._rest = RestStates(self.model, Layout.of(self.model, task.joints, str(robot.mjcf)), FULLPHYSICS)

    def take(self, stepper: Stepper) -> None:
        """Move to the state of the first simulation; stay where that has left all bounds."""
        states = np.concatenate([stepper.states[:1], stepper.objects[:1]], axis=1)
        if not np.isfinite(states).all():
            return
        positions, _ = self._rest.motion(self._rest(states))
        self.data.qpos[:] = positions[0]
        mujoco.mj_forward(self.model, self.data)


class Window:
    """A window that shows a pose, at the pace of the clock."""

    def __init__(self, pose: Pose, period: float) -> None:
        """Open the window.

        Args:
            pose: What it shows.
            period: Time between two pictures [s]; a simulation that is faster waits.

        Raises:
            OptionError: there is no screen.
        """
        if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise OptionError(f"render_mode='{HUMAN}' needs a screen, and there is none; use '{RGB_ARRAY}'.")
        self._period, self._due = period, time.monotonic()
        self._viewer = mujoco.viewer.launch_passive(pose.model, pose.data, show_left_ui=False, show_right_ui=False)

    def show(self) -> None:
        """Show the pose as it is, once its time has come."""
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = time.monotonic() + self._period
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()
