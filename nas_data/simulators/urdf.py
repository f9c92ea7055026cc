"""Export of a compiled MuJoCo model as URDF."""

from dataclasses import dataclass
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np

from nas_data.simulators.yielding_stops import find_yielding_stops

ROTOR = "_rotor"  # suffix of the link with a joint's reflected inertia
LEAST_MASS = 1e-6  # [kg] mass of links without mass, which physics engines refuse
LEAST_ROTOR = 1e-6  # [kg m²] least reflected inertia of joints in series, on which torques act
LEAST_INERTIA = 1e-9  # [kg m²] inertia of links without mass, far below any armature


@dataclass(frozen=True)
class UrdfExport:
    """A URDF, and the gears that URDF cannot express.

    Attributes:
        text: The URDF.
        joints: Indices of the model's joints in the URDF, which keeps their names.
        rotors: Indices of joints with reflected inertia. For each, the URDF has a flywheel `<joint>_rotor` on the
            base; the engine must gear it to the joint one to one.
    """

    text: str
    joints: tuple[int, ...]
    rotors: tuple[int, ...]


def to_urdf(model: mujoco.MjModel) -> UrdfExport:
    """Export the bodies of a model as URDF.

    Hinges and slides keep names, axes and limits. A body with several joints becomes a chain of links. A joint's
    reflected inertia becomes a flywheel on the base: inertia added to a link would also act on all joints before it.
    Colliding boxes, spheres, cylinders and capsules are kept; meshes and planes are dropped.
    The model has no ball or free joint.
    """
    robot = Xml.Element("robot", name="model")
    add_link(robot, "world")
    anchors = {0: np.zeros(3)}
    rotors = []
    for body in range(1, model.nbody):
        anchors[body] = add_body(robot, model, body, anchors[int(model.body_parentid[body])])
    for joint in range(model.njnt):
        if compute_rotor_inertia(model, joint) > 0:
            add_rotor(robot, model, joint)
            rotors.append(joint)
    Xml.indent(robot)
    return UrdfExport(Xml.tostring(robot, encoding="unicode"), tuple(range(model.njnt)), tuple(rotors))


def add_body(robot: Xml.Element, model: mujoco.MjModel, body: int, parent_anchor: np.ndarray) -> np.ndarray:
    """Add a body's joints and links; return its link's origin in the body frame [m], shape (3,)."""
    parent = link_name(model, int(model.body_parentid[body]))
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    position, rotation = model.body_pos[body] - parent_anchor, model.body_quat[body]
    anchor = np.zeros(3)
    turned = np.empty(3)
    for joint in range(first, first + count):
        mujoco.mju_rotVecQuat(turned, model.jnt_pos[joint] - anchor, rotation)
        last = joint == first + count - 1
        child = link_name(model, body) if last else f"{find_joint_name(model, joint)}_carrier"
        add_joint(robot, model, joint, parent, child, position + turned, rotation)
        if not last:
            add_link(robot, child)
        anchor = model.jnt_pos[joint].copy()
        parent, position, rotation = child, np.zeros(3), np.array([1.0, 0, 0, 0])
    if not count:
        add_weld(robot, parent, link_name(model, body), position, rotation)
    link = add_link(robot, link_name(model, body), model, body, anchor)
    add_geoms(link, model, body, anchor)
    return anchor


def find_joint_name(model: mujoco.MjModel, joint: int) -> str:
    """Return a joint's name; a unique one if the model gives none."""
    return model.joint(joint).name or f"joint_{joint}"


def link_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body's link."""
    return "world" if body == 0 else f"{model.body(body).name or 'body'}_{body}"


def add_link(
    robot: Xml.Element, name: str, model: mujoco.MjModel | None = None, body: int = 0, anchor: np.ndarray | None = None
) -> Xml.Element:
    """Add a link with a body's inertia; without a body the inertia is minimal.

    Args:
        robot: Element to which the link is added.
        name: Name of the link.
        model: Compiled model; None for a link without a body.
        body: Index of the body.
        anchor: Origin of the link in the body frame [m], shape (3,); zero if None.
    """
    link = Xml.SubElement(robot, "link", name=name)
    if model is None or model.body_mass[body] <= 0:
        add_inertia(link, LEAST_MASS, np.full(3, LEAST_INERTIA), np.zeros(3), np.array([1.0, 0, 0, 0]))
    else:
        centre = model.body_ipos[body] - (np.zeros(3) if anchor is None else anchor)
        add_inertia(link, model.body_mass[body], model.body_inertia[body], centre, model.body_iquat[body])
    return link


def add_inertia(link: Xml.Element, mass: float, inertia: np.ndarray, centre: np.ndarray, rotation: np.ndarray) -> None:
    """Add mass [kg], principal inertia [kg m²], centre of mass [m] and the quaternion of the principal axes."""
    inertial = Xml.SubElement(link, "inertial")
    inertial.append(make_origin(centre, rotation))
    Xml.SubElement(inertial, "mass", value=format_number(mass))
    moments = {key: format_number(value) for key, value in zip(("ixx", "iyy", "izz"), inertia, strict=True)}
    Xml.SubElement(inertial, "inertia", moments | {"ixy": "0", "ixz": "0", "iyz": "0"})


def add_joint(
    robot: Xml.Element,
    model: mujoco.MjModel,
    joint: int,
    parent: str,
    child: str,
    position: np.ndarray,
    rotation: np.ndarray,
) -> None:
    """Add one hinge or slide, whose zero is the model's reference posture."""
    name = find_joint_name(model, joint)
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): "revolute", int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic"}
    kind = kinds[int(model.jnt_type[joint])]
    limited = bool(model.jnt_limited[joint]) and joint not in find_yielding_stops(model)  # which act as springs
    low, high = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]] if limited else (-1e3, 1e3)
    element = Xml.SubElement(
        robot, "joint", name=name, type="continuous" if kind == "revolute" and not limited else kind
    )
    element.append(make_origin(position, rotation))
    Xml.SubElement(element, "parent", link=parent)
    Xml.SubElement(element, "child", link=child)
    Xml.SubElement(element, "axis", xyz=format_numbers(model.jnt_axis[joint]))
    Xml.SubElement(element, "limit", lower=format_number(low), upper=format_number(high), effort="1e6", velocity="1e6")


def add_weld(robot: Xml.Element, parent: str, child: str, position: np.ndarray, rotation: np.ndarray) -> None:
    """Weld a link to another."""
    element = Xml.SubElement(robot, "joint", name=f"{child}_weld", type="fixed")
    element.append(make_origin(position, rotation))
    Xml.SubElement(element, "parent", link=parent)
    Xml.SubElement(element, "child", link=child)


def compute_rotor_inertia(model: mujoco.MjModel, joint: int) -> float:
    """Return a joint's reflected inertia [kg m²]; joints in series have at least `LEAST_ROTOR`."""
    series = model.body_jntnum[model.jnt_bodyid[joint]] > 1
    return max(float(model.dof_armature[model.jnt_dofadr[joint]]), LEAST_ROTOR if series else 0.0)


def add_rotor(robot: Xml.Element, model: mujoco.MjModel, joint: int) -> None:
    """Add a joint's reflected inertia as a flywheel on the base, where no other joint turns it."""
    name = find_joint_name(model, joint) + ROTOR
    inertia = compute_rotor_inertia(model, joint)
    link = Xml.SubElement(robot, "link", name=name)
    add_inertia(link, LEAST_MASS, np.full(3, inertia), np.zeros(3), np.array([1.0, 0, 0, 0]))
    element = Xml.SubElement(robot, "joint", name=name, type="continuous")
    Xml.SubElement(element, "parent", link="world")
    Xml.SubElement(element, "child", link=name)
    Xml.SubElement(element, "axis", xyz="0 0 1")


def add_geoms(link: Xml.Element, model: mujoco.MjModel, body: int, anchor: np.ndarray) -> None:
    """Add a body's colliding primitives as collision and visual shapes."""
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        shape = make_primitive(model, geom)
        collides = model.geom_contype[geom] or model.geom_conaffinity[geom]
        if shape is None or not collides:
            continue
        for role in ("visual", "collision"):
            element = Xml.SubElement(link, role)
            element.append(make_origin(model.geom_pos[geom] - anchor, model.geom_quat[geom]))
            Xml.SubElement(element, "geometry").append(shape)


def make_primitive(model: mujoco.MjModel, geom: int) -> Xml.Element | None:
    """Return a geom as a URDF shape, which has full lengths; None for other shapes than primitives."""
    size = model.geom_size[geom]
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return Xml.Element("box", size=format_numbers(2 * size))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return Xml.Element("sphere", radius=format_number(size[0]))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return Xml.Element("cylinder", radius=format_number(size[0]), length=format_number(2 * size[1]))
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return Xml.Element("capsule", radius=format_number(size[0]), length=format_number(2 * size[1]))
    return None


def make_origin(position: np.ndarray, rotation: np.ndarray) -> Xml.Element:
    """Return an `<origin>` from a position [m] and a quaternion (w, x, y, z)."""
    return Xml.Element("origin", xyz=format_numbers(position), rpy=format_numbers(roll_pitch_yaw(rotation)))


def roll_pitch_yaw(rotation: np.ndarray) -> np.ndarray:
    """Return roll, pitch and yaw about fixed axes [rad], shape (3,), of a quaternion (w, x, y, z)."""
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, rotation)
    r = flat.reshape(3, 3)
    level = np.hypot(r[0, 0], r[1, 0])
    if level < 1e-9:  # gimbal lock: only the sum or difference of roll and yaw is determined
        return np.array([np.arctan2(-r[1, 2], r[1, 1]), np.arctan2(-r[2, 0], level), 0.0])
    return np.array([np.arctan2(r[2, 1], r[2, 2]), np.arctan2(-r[2, 0], level), np.arctan2(r[1, 0], r[0, 0])])


def format_number(value: float) -> str:
    """Return a number as text that reads back as the same double."""
    return repr(float(value))


def format_numbers(values: np.ndarray) -> str:
    """Return numbers as text, separated by spaces."""
    return " ".join(format_number(value) for value in values)
