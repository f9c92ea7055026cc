"""An episode in Rerun: ghosts in three dimensions, and its signals under the names of LeRobot's viewer.

LeRobot's `lerobot-dataset-viz` logs `action` and `state` on the timelines `frame_index` and `timestamp`, one plot each,
in a grid. Here the ghosts replace the cameras, and `sim_state` and `error` of each model are added.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np

from nas_data.dataset.features import ACTION, STATE
from nas_data.errors import MissingPackage, OptionError
from nas_data.reports.films.motion import Motion
from nas_data.reports.films.scene import Scene, choose_colour

ARMS, STATES, SIMULATED, ERRORS = "ghosts", "state", "sim_state", "error"


def load_rerun() -> ModuleType:
    """Return Rerun's package.

    Raises:
        MissingPackage: it is not installed; names the extra that installs it.
    """
    try:
        import rerun
    except ImportError:
        raise MissingPackage("nas view needs Rerun: pip install 'nas_data[viz]'") from None
    return rerun


class RerunLog:
    """A recording of one episode, in a window or in a file."""

    def __init__(self, name: str, episode: int, path: Path | None = None) -> None:
        """Check that the episode can be shown.

        Args:
            name: Name of the dataset.
            episode: Number of the episode.
            path: File to write; None for a window.

        Raises:
            MissingPackage: Rerun is not installed.
            OptionError: there is no screen for a window.
        """
        self._rerun = load_rerun()
        screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if path is None and sys.platform == "linux" and not screen:
            raise OptionError("Rerun's window needs a screen, and there is none; write a file with --out FILE.rrd.")
        self._name, self._path = f"{name}/episode_{episode}", path

    def log(self, motion: Motion) -> None:
        """Show or write an episode."""
        rerun = self._rerun
        stream = rerun.RecordingStream(self._name)
        layout = make_blueprint(motion)
        if self._path is None:
            stream.spawn(default_blueprint=layout)
        else:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            stream.save(self._path, default_blueprint=layout)
        with stream:
            log_signals(motion)
            log_arms(motion)
        stream.flush()


def log_signals(motion: Motion) -> None:
    """Log commands, measurements and predictions, one row per frame, as LeRobot does."""
    dataset = motion.dataset
    send(ACTION, motion, dataset.commands)
    send(STATES, motion, motion.ghosts[0].states[:, : dataset.states.shape[1]])
    for ghost in motion.ghosts[1:]:
        send(format_entity_path(SIMULATED, ghost.name), motion, ghost.states[:, : dataset.states.shape[1]])
        factors = np.array([unit.factor for unit in motion.units])
        send(format_entity_path(ERRORS, ghost.name), motion, ghost.errors * factors)


def format_entity_path(kind: str, name: str) -> str:
    """Return the entity path for an arm, with characters escaped that a path cannot hold."""
    return f"{kind}/{load_rerun().escape_entity_path_part(name)}"


def send(path: str, motion: Motion, values: np.ndarray) -> None:
    """Log rows of numbers (rows, width) from the episode's first frame on."""
    rerun = load_rerun()
    columns = rerun.Scalars.columns(scalars=np.asarray(values, float).ravel())
    rows = columns.partition(np.full(len(values), values.shape[1]))
    rerun.send_columns(path, indexes=make_timelines(motion, len(values)), columns=rows)


def make_timelines(motion: Motion, count: int) -> list[object]:
    """Return the first `count` frames on LeRobot's two timelines."""
    rerun = load_rerun()
    return [
        rerun.TimeColumn("frame_index", sequence=np.arange(count)),
        rerun.TimeColumn("timestamp", timestamp=motion.times[:count]),
    ]


def log_arms(motion: Motion) -> None:
    """Log the shapes of each body once, and the poses of the bodies in each frame."""
    rerun, scene = load_rerun(), Scene(motion)
    model, count = scene.model, len(scene)
    places, turns = np.empty((count, model.nbody, 3)), np.empty((count, model.nbody, 4))
    for frame in range(count):
        scene.show(frame)
        places[frame], turns[frame] = scene.data.xpos, scene.data.xquat[:, [1, 2, 3, 0]]  # Rerun has w last
    rerun.log(ARMS, rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for body in range(model.nbody):
        ghost = int(scene.owner[body])
        path = f"{format_entity_path(ARMS, motion.ghosts[ghost].name)}/{body}"
        geoms = [geom for geom in np.flatnonzero(model.geom_bodyid == body) if scene.shown[geom]]
        for geom in geoms:
            shape = make_shape(model, int(geom), [round(255 * part) for part in choose_colour(ghost)])
            if shape is not None:
                rerun.log(f"{path}/{geom}", shape, static=True)
        if geoms:
            moved = rerun.Transform3D.columns(translation=places[:, body], quaternion=turns[:, body])
            rerun.send_columns(path, indexes=make_timelines(motion, count), columns=moved)


def make_shape(model: mujoco.MjModel, geom: int, shade: Sequence[int]) -> object | None:
    """Return a geom as a Rerun shape in its body's frame; None for floors and height fields."""
    rerun = load_rerun()
    size, at = model.geom_size[geom], model.geom_pos[geom]
    turn = rerun.Quaternion(xyzw=model.geom_quat[geom][[1, 2, 3, 0]])
    placed = {"quaternions": [turn], "colors": [shade], "fill_mode": "solid"}
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        start = at + rotate_vectors(
            np.array([0.0, 0.0, -size[1]]), model.geom_quat[geom]
        )  # Rerun's capsules begin at their lower cap
        return rerun.Capsules3D(lengths=[2 * size[1]], radii=[size[0]], translations=[start], **placed)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return rerun.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], centers=[at], **placed)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return rerun.Boxes3D(half_sizes=[size], centers=[at], **placed)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        halves = np.full(3, size[0]) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
        return rerun.Ellipsoids3D(half_sizes=[halves], centers=[at], **placed)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(int(model.geom_dataid[geom]))
        corners = slice(int(mesh.vertadr[0]), int(mesh.vertadr[0] + mesh.vertnum[0]))
        faces = slice(int(mesh.faceadr[0]), int(mesh.faceadr[0] + mesh.facenum[0]))
        moved = at + rotate_vectors(model.mesh_vert[corners], model.geom_quat[geom])
        return rerun.Mesh3D(vertex_positions=moved, triangle_indices=model.mesh_face[faces], albedo_factor=shade)
    return None


def rotate_vectors(vectors: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Rotate vectors (…, 3) by a quaternion (4,), w first."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return np.asarray(vectors @ matrix.reshape(3, 3).T)


def make_blueprint(motion: Motion) -> object:
    """Return the layout: the ghosts, then one plot per signal, with the names of its components."""
    rerun = load_rerun()
    import rerun.blueprint as views

    state, action = motion.dataset.features[STATE].names, motion.dataset.features[ACTION].names
    errors = [f"RMSE [{unit.shown}]" for unit in motion.units]
    plots: list[tuple[str, Sequence[str]]] = [(ACTION, action), (STATES, state)]
    for ghost in motion.ghosts[1:]:
        plots += [(format_entity_path(SIMULATED, ghost.name), state), (format_entity_path(ERRORS, ghost.name), errors)]
    shown: list[views.View] = [views.Spatial3DView(origin=ARMS, name=ARMS)]
    for path, names in plots:
        lines = rerun.SeriesLines(names=list(names))
        shown.append(views.TimeSeriesView(origin=path, name=path, overrides={path: lines}))
    return views.Blueprint(views.Grid(*shown))
