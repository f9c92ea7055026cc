"""What an environment looks like: pictures from MuJoCo's offscreen renderer, or a window that follows the arm."""

import importlib
import os
import sys
import time
from collections.abc import Callable
from typing import Protocol

import mujoco
import mujoco.viewer
import numpy as np

from nas_data.arrays import Array
from nas_data.envs.base import Task
from nas_data.envs.loop.arm_env import HUMAN, RGB_ARRAY
from nas_data.errors import MissingPackage, OptionError
from nas_data.simulators.base import Stepper
from nas_data.simulators.layout import FULLPHYSICS, Layout, RestStates

SIZE = (480, 640)  # [px] height and width of a picture
GEOMS = 5_000  # that a scene has room for; MuJoCo leaves further ones out
BACKENDS = {"linux": ("egl", "osmesa", "glfw"), "darwin": ("cgl", "glfw")}
UNUSABLE = (ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError)  # what a missing library raises


class Context(Protocol):
    """An OpenGL context, as MuJoCo's backends define one."""

    def __init__(self, max_width: int, max_height: int) -> None:
        """Create it for pictures up to a size [px]."""

    def make_current(self) -> None:
        """Draw here from now on."""

    def free(self) -> None:
        """Give it back."""


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


class Pictures:
    """Pictures of a pose, drawn without a window."""

    def __init__(self, pose: Pose) -> None:
        """Open the renderer.

        Raises:
            MissingPackage: this machine has no library that draws without a window; names one.
        """
        self._pose = pose
        height, width = SIZE
        pose.model.vis.global_.offwidth, pose.model.vis.global_.offheight = width, height
        self._context = open_context(width, height)
        self._scene = mujoco.MjvScene(pose.model, GEOMS)
        self._renderer = mujoco.MjrContext(pose.model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        self._camera, self._options = mujoco.MjvCamera(), mujoco.MjvOption()
        mujoco.mjv_defaultFreeCamera(pose.model, self._camera)

    def draw(self) -> Array:
        """Return a picture, shape (height, width, 3), uint8."""
        self._context.make_current()
        pose, picture, area = self._pose, np.empty((*SIZE, 3), np.uint8), mujoco.MjrRect(0, 0, SIZE[1], SIZE[0])
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(pose.model, pose.data, self._options, None, self._camera, everything, self._scene)
        mujoco.mjr_render(area, self._scene, self._renderer)
        mujoco.mjr_readPixels(picture, None, area, self._renderer)
        return picture[::-1].copy()  # OpenGL counts rows from below

    def close(self) -> None:
        """Give the renderer back."""
        self._context.make_current()
        self._renderer.free()
        self._context.free()


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


def open_context(width: int, height: int) -> Context:
    """Open what draws pictures of a size [px]: by `MUJOCO_GL` where that is set, else what the machine has.

    Raises:
        MissingPackage: nothing works; names a package.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    for name in (wanted,) if wanted in ("egl", "osmesa", "glfw", "cgl") else BACKENDS.get(sys.platform, ("glfw",)):
        try:
            create: Callable[[int, int], Context] = importlib.import_module(f"mujoco.{name}").GLContext
            context = create(width, height)
            context.make_current()
        except UNUSABLE:
            continue
        return context
    raise MissingPackage(
        "Nothing on this machine draws pictures without a window; install a package that does: "
        "apt install libegl1 (or libosmesa6), and leave MUJOCO_GL unset."
    )
