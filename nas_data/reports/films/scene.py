"""One MuJoCo scene with all arms of a film at the same position, each in its own colour."""

import warnings
from collections.abc import Sequence

import mujoco
import numpy as np

from nas_data.errors import ModelFileError
from nas_data.mjcf.bake_inertia import bake_inertia
from nas_data.mjcf.engine_warnings import collect_warnings
from nas_data.mjcf.export import find_file, find_references
from nas_data.reports.films.motion import Ghost, Motion

# measured grey, then the models as in the charts: blue, orange, green, purple of Okabe and Ito's palette
COLOURS = ((0.42, 0.42, 0.45), (0.0, 0.45, 0.7), (0.9, 0.62, 0.0), (0.0, 0.62, 0.45), (0.8, 0.47, 0.65))
TRANSPARENCY = 0.55  # alpha of the models; the measured arm is solid
GROUND = (0.93, 0.93, 0.94, 1.0)  # colour of planes
HIDDEN_GROUPS = 3  # first geom group that MuJoCo hides by default: collision shapes, by convention
SAMPLED = 40  # postures of an episode that must fit into the picture
ROD_WIDTH = 0.06  # radius of the rods of a model without shapes, as a share of the longest
MIN_ROD = 0.01  # shorter rods are drawn as balls, as a share of the longest
MARGIN = 1.08  # camera distance over the distance at which everything just fits
PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
HEIGHT_FIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)


class Scene:
    """The ghosts of an episode in one compiled model, without physics and collisions.

    Fixed parts (base, table, floor) are drawn once, with the measured arm.
    """

    def __init__(self, motion: Motion) -> None:
        """Compose and colour the scene.

        Raises:
            ModelFileError: the models cannot be combined in one scene.
        """
        self._postures = np.concatenate([ghost.postures() for ghost in motion.ghosts], axis=1)
        self.model, self.owner = compose(motion.ghosts)  # `owner`: ghost of each body, shape (nbody,)
        self.data = mujoco.MjData(self.model)
        self.shown = paint(self.model, self.owner)  # whether each geom is drawn, shape (ngeom,)

    def __len__(self) -> int:
        """Return the number of frames, T + 1."""
        return len(self._postures)

    def show(self, frame: int) -> None:
        """Move every ghost to its posture at a frame."""
        self.data.qpos[:] = self._postures[frame]
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def camera(self, azimuth: float, elevation: float, aspect: float) -> mujoco.MjvCamera:
        """Return a camera that sees all postures of the episode.

        Args:
            azimuth: Azimuth of its view [deg].
            elevation: Elevation of its view [deg].
            aspect: Width over height of the picture.
        """
        turn, lift = np.radians(azimuth), np.radians(elevation)
        forward = np.array([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)])
        right = np.array([np.sin(turn), -np.cos(turn), 0.0])
        axes = np.stack([right, np.cross(right, forward), forward])
        seen = self.corners() @ axes.T  # right, up and depth of each corner
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
        slope = np.tan(np.radians(self.model.vis.global_.fovy) / 2)
        beside = np.abs(seen[:, :2] - middle[:2]) / (slope * np.array([aspect, 1.0]))
        camera = mujoco.MjvCamera()
        camera.lookat, camera.azimuth, camera.elevation = middle @ axes, azimuth, elevation
        camera.distance = MARGIN * float((beside.max(axis=1) - (seen[:, 2] - middle[2])).max())
        return camera

    def corners(self) -> np.ndarray:
        """Return the corners of the boxes around all drawn geoms, in postures of the whole episode, shape (…, 3)."""
        boxed = np.flatnonzero(self.shown & ~np.isin(self.model.geom_type, (PLANE, HEIGHT_FIELD)))
        signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, 8).T
        local = self.model.geom_aabb[boxed, None, :3] + signs * self.model.geom_aabb[boxed, None, 3:]
        found = []
        for frame in np.unique(np.linspace(0, len(self) - 1, SAMPLED).astype(int)):
            self.show(int(frame))
            turned = self.data.geom_xmat[boxed].reshape(-1, 3, 3)
            found.append(self.data.geom_xpos[boxed, None] + np.einsum("gij,gcj->gci", turned, local))
        return np.concatenate(found).reshape(-1, 3)


def choose_colour(number: int) -> tuple[float, float, float, float]:
    """Return red, green, blue and alpha of a ghost, 0 to 1; 0 is the measured arm."""
    shade = COLOURS[0] if number == 0 else COLOURS[1 + (number - 1) % (len(COLOURS) - 1)]
    return (*shade, TRANSPARENCY if number else 1.0)


def compose(ghosts: Sequence[Ghost]) -> tuple[mujoco.MjModel, np.ndarray]:
    """Attach the ghosts' models to one model, with their numbers as prefixes.

    Returns:
        The compiled scene, whose `qpos` concatenates that of the ghosts, and the ghost of each body.

    Raises:
        ModelFileError: MuJoCo cannot compile the scene.
    """
    scene, parts = mujoco.MjSpec(), [strip_model(ghost, with_world=number == 0) for number, ghost in enumerate(ghosts)]
    light_up(scene)
    try:
        # warnings concern differing options such as the integrator, which are irrelevant without simulation
        with collect_warnings(), warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            for number, part in enumerate(parts):
                scene.attach(part, prefix=f"{number}/", frame=scene.worldbody.add_frame())
            model = scene.compile()
    except (ValueError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        files = ", ".join(dict.fromkeys(str(ghost.simulator.robot.mjcf) for ghost in ghosts))
        raise ModelFileError(f"{files} cannot be drawn in one scene: {reason}; render one --model at a time.") from None
    names = [
        model.body(body).name.partition("/") for body in range(model.nbody)
    ]  # `strip_model` names all bodies but the world
    return model, np.array([int(number) if slash else 0 for number, slash, _ in names])


def strip_model(ghost: Ghost, with_world: bool) -> mujoco.MjSpec:
    """Return only bodies, joints and shapes of a ghost's model, optionally with those fixed to the world."""
    spec = bake_inertia(ghost.spec())
    for reference in find_references(spec):  # relative paths would be resolved against the scene, which is no file
        file = find_file(spec, reference, ghost.simulator.robot.mjcf)
        if file is not None:
            reference.redirect(str(file.resolve()))
    spec.strippath = False
    acting = (spec.keys, spec.sensors, spec.actuators, spec.equalities, spec.pairs, spec.excludes, spec.tendons)
    for group in (*acting, spec.lights, spec.cameras, spec.skins, spec.sites):
        for item in list(group):
            spec.delete(item)
    for geom in list(spec.geoms):
        geom.contype = geom.conaffinity = 0
        if geom.parent.name == "world" and not with_world:
            spec.delete(geom)
    add_rods(spec)
    return spec


def add_rods(spec: mujoco.MjSpec) -> None:
    """Draw rods from joint to joint in a model of which nothing that moves has a shape.

    MuJoCo leaves out the visual shapes of a URDF, and some have no others.
    """
    model = spec.copy().compile()
    if (model.body_weldid[model.geom_bodyid] != 0).any():
        return
    rods = [
        (parent, model.body_pos[child])
        for child, parent in enumerate(model.body_parentid)
        if parent and model.body_weldid[child]
    ]
    # The end of the last link is where it is if the link is uniform.
    rods += [(leaf, 2 * model.body_ipos[leaf]) for leaf in set(range(1, model.nbody)) - set(model.body_parentid)]
    length = max((float(np.linalg.norm(end)) for _, end in rods), default=0.0)
    for body, end in rods:
        geom = spec.body(model.body(body).name).add_geom(contype=0, conaffinity=0, mass=0)
        if np.linalg.norm(end) > MIN_ROD * length:
            geom.type, geom.fromto = mujoco.mjtGeom.mjGEOM_CAPSULE, [0, 0, 0, *end]
        geom.size = [ROD_WIDTH * (length or 1.0), 0, 0]


def light_up(scene: mujoco.MjSpec) -> None:
    """Give a scene a bright background and even light."""
    sky = scene.add_texture(name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=384)
    sky.builtin, sky.rgb1, sky.rgb2 = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, [1.0, 1.0, 1.0], [0.88, 0.9, 0.93]
    headlight = scene.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = [0.45] * 3, [0.45] * 3, [0.05] * 3
    light = scene.worldbody.add_light(pos=[0, 0, 3], dir=[-0.4, 0.3, -1], castshadow=False)
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.diffuse, light.specular = [0.4] * 3, [0.1] * 3


def paint(model: mujoco.MjModel, owner: np.ndarray) -> np.ndarray:
    """Colour each ghost's geoms, by the owner of each body (nbody,); return which geoms are drawn, shape (ngeom,).

    Geoms in groups that MuJoCo hides stay hidden unless a ghost has no others.
    """
    owners, fixed = owner[model.geom_bodyid], model.body_weldid[model.geom_bodyid] == 0
    visible = (model.geom_group < HIDDEN_GROUPS) & (model.geom_rgba[:, 3] > 0)
    for number in np.unique(owner):
        own = (owners == number) & (model.geom_type != PLANE)
        if not (visible & own).any():
            visible |= own
            model.geom_group[own] = 0
        model.geom_rgba[owners == number] = choose_colour(int(number))
    visible &= ~(fixed & (owners > 0))
    model.geom_rgba[model.geom_type == PLANE] = GROUND
    model.geom_rgba[~visible, 3] = 0.0
    model.geom_matid[:] = -1
    return np.asarray(visible)
