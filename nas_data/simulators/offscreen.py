"""Offscreen rendering of a compiled model."""

import importlib
import os
import sys
from collections.abc import Callable
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from nas_data.errors import MissingPackage, OptionError

SIZE = (480, 640)  # [px] height and width of an image
GEOMS = 5_000  # capacity of a scene; MuJoCo drops further geoms
BACKENDS = {"linux": ("egl", "osmesa", "glfw"), "darwin": ("cgl", "glfw")}
UNUSABLE = (ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError)  # raised if a library is missing


class OpenGlContext(Protocol):
    """Interface of the OpenGL contexts of MuJoCo's backends."""

    def __init__(self, max_width: int, max_height: int) -> None:
        """Create a context for images up to a size [px]."""

    def make_current(self) -> None:
        """Make this the current context."""

    def free(self) -> None:
        """Free the context."""


class OffscreenRenderer:
    """Renders a model in the posture of its data."""

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
            data: Data with the posture; it is read at each image.
            size: Height and width of the images [px].
            camera: Camera; the model's default free camera if None.

        Raises:
            MissingPackage: this machine has no library for offscreen rendering; names a package.
            OptionError: the images are too large for the graphics of this machine.
        """
        self._model, self._data, self._size = model, data, size
        height, width = size
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._context = open_context(width, height)
        self._scene = mujoco.MjvScene(model, GEOMS)
        try:
            self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        except mujoco.FatalError as error:  # the limit differs between machines, so that it cannot be checked before
            self._context.free()
            raise OptionError(
                f"The graphics of this machine cannot draw an image of {width} × {height} pixels ({error}); choose a "
                "smaller width or height, such as 960 × 720."
            ) from None
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        self._options = mujoco.MjvOption()
        if camera is None:
            camera = mujoco.MjvCamera()
            mujoco.mjv_defaultFreeCamera(model, camera)
        self._camera = camera

    def draw(self) -> NDArray[np.uint8]:
        """Return an image, shape (height, width, 3), uint8."""
        self._context.make_current()
        height, width = self._size
        image, area = np.empty((height, width, 3), np.uint8), mujoco.MjrRect(0, 0, width, height)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._options, None, self._camera, everything, self._scene)
        mujoco.mjr_render(area, self._scene, self._renderer)
        mujoco.mjr_readPixels(image, None, area, self._renderer)
        return image[::-1].copy()  # OpenGL numbers rows from the bottom

    def close(self) -> None:
        """Free the renderer."""
        self._context.make_current()
        self._renderer.free()
        self._context.free()


def open_context(width: int, height: int) -> OpenGlContext:
    """Open a context for images of a size [px], with the backend in `MUJOCO_GL` or the first one that works.

    Raises:
        MissingPackage: no backend works; names a package.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    for name in (wanted,) if wanted in ("egl", "osmesa", "glfw", "cgl") else BACKENDS.get(sys.platform, ("glfw",)):
        try:
            create: Callable[[int, int], OpenGlContext] = importlib.import_module(f"mujoco.{name}").GLContext
            context = create(width, height)
            context.make_current()
            if name == "glfw" and not importlib.import_module("glfw").get_current_context():
                continue  # without a display, nothing is raised
        except UNUSABLE:
            continue
        return context
    raise MissingPackage(
        "Nothing on this machine draws pictures without a window; install a package that does: "
        "apt install libegl1 (or libosmesa6), and leave MUJOCO_GL unset."
    )
