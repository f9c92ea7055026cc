"""Pictures of a compiled model, drawn without a window by MuJoCo's offscreen renderer."""

import importlib
import os
import sys
from collections.abc import Callable
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from nas_data.errors import MissingPackage

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


class Pictures:
    """Pictures of a model in the posture of its data."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        size: tuple[int, int] = SIZE,
        camera: mujoco.MjvCamera | None = None,
    ) -> None:
        """Open the renderer.

        Args:
            model: Compiled model.
            data: Its posture, as it is whenever a picture is drawn.
            size: Height and width of a picture [px].
            camera: Where it is seen from; as the model says where None.

        Raises:
            MissingPackage: this machine has no library that draws without a window; names one.
        """
        self._model, self._data, self._size = model, data, size
        height, width = size
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._context = open_context(width, height)
        self._scene = mujoco.MjvScene(model, GEOMS)
        self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        self._options = mujoco.MjvOption()
        if camera is None:
            camera = mujoco.MjvCamera()
            mujoco.mjv_defaultFreeCamera(model, camera)
        self._camera = camera

    def draw(self) -> NDArray[np.uint8]:
        """Return a picture, shape (height, width, 3), uint8."""
        self._context.make_current()
        height, width = self._size
        picture, area = np.empty((height, width, 3), np.uint8), mujoco.MjrRect(0, 0, width, height)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._options, None, self._camera, everything, self._scene)
        mujoco.mjr_render(area, self._scene, self._renderer)
        mujoco.mjr_readPixels(picture, None, area, self._renderer)
        return picture[::-1].copy()  # OpenGL counts rows from below

    def close(self) -> None:
        """Give the renderer back."""
        self._context.make_current()
        self._renderer.free()
        self._context.free()


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
