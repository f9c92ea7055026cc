"""One robot in one PyBullet world: loaded from a MuJoCo model, driven by joint torques."""

import contextlib
import ctypes
import os
import sys
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np

from nas_data.errors import MissingPackage, ModelFileError
from nas_data.simulators.urdf import ROTOR, find_joint_name, link_name, to_urdf

SOFT = 0.5  # a constraint with a smaller impedance (solimp dmin) counts as soft; MuJoCo's default is 0.9
RIGID = 1e9  # [N·m] largest torque of a gear, so that none slips
UNBOUNDED = 1e5  # [rad/s] speed limit; PyBullet's default of 100 rad/s can be reached before a projection


def import_pybullet() -> ModuleType:
    """Import PyBullet.

    Raises:
        MissingPackage: it is not installed.
    """
    try:
        with silence():
            import pybullet
    except ImportError:
        raise MissingPackage("The engine bullet needs PyBullet: pip install 'nas_data[bullet]'") from None
    return pybullet


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Discard what PyBullet prints from C: the program's output may be JSON."""
    sys.stdout.flush()
    sys.stderr.flush()
    library = ctypes.CDLL(None)
    library.fflush(None)
    kept = {stream: os.dup(stream) for stream in (1, 2)}
    with Path(os.devnull).open("w") as nowhere:
        for stream in kept:
            os.dup2(nowhere.fileno(), stream)
        try:
            yield
        finally:
            library.fflush(None)
            for stream, copied in kept.items():
                os.dup2(copied, stream)
                os.close(copied)


class BulletWorld:
    """A PyBullet client with one robot, gravity and the model's planes.

    A joint's reflected inertia is a flywheel geared to the joint. Torques and Coulomb friction act on the flywheel, if
    there is one. The direct (Dantzig) solver makes gears and friction exact. The default, iterative solver leaves
    errors of degrees in a light arm behind heavy rotors. Friction is a velocity motor with target zero, limited to
    the friction torque.
    """

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        """Load the model.

        Args:
            model: Compiled model of hinges and slides, with timestep and gravity.
            name: Name of the model in errors.

        Raises:
            MissingPackage: PyBullet is not installed.
            ModelFileError: PyBullet cannot simulate the model.
        """
        refuse_unsupported(model, name)
        self.bullet = import_pybullet()
        self.friction = np.zeros(model.nv)
        with silence():
            self.client = self.bullet.connect(self.bullet.DIRECT)
            if self.client < 0:
                raise ModelFileError("PyBullet holds at most 1024 worlds in one process; use fewer simulations.")
            self.close = weakref.finalize(self, disconnect, self.bullet, self.client)
            self._load(model)

    def set(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set MuJoCo's joint positions (nq,) and velocities (nv,)."""
        reset = self.bullet.resetJointState
        for joint, position, speed in zip(self.joints, (qpos - self.zero).tolist(), qvel.tolist(), strict=True):
            reset(self.robot, joint, position, speed, physicsClientId=self.client)
        for rotor, position, speed in zip(
            self.rotors, (qpos - self.zero)[self.geared].tolist(), qvel[self.geared].tolist(), strict=True
        ):
            reset(self.robot, rotor, position, speed, physicsClientId=self.client)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return MuJoCo's joint positions (nq,) and velocities (nv,)."""
        states = self.bullet.getJointStates(self.robot, self.joints, physicsClientId=self.client)
        return np.array([state[0] for state in states]) + self.zero, np.array([state[1] for state in states])

    def step(self, torques: np.ndarray) -> None:
        """Apply joint torques [N·m; N], shape (nv,), for one physics timestep."""
        self.bullet.setJointMotorControlArray(
            self.robot,
            self.driven,
            self.bullet.TORQUE_CONTROL,
            forces=torques.tolist(),
            physicsClientId=self.client,
        )
        self.bullet.stepSimulation(physicsClientId=self.client)

    def set_friction(self, torques: np.ndarray) -> None:
        """Set the Coulomb friction of each joint [N·m; N], shape (nv,)."""
        for dof in np.flatnonzero(torques != self.friction):
            self.bullet.setJointMotorControl2(
                self.robot,
                self.driven[dof],
                self.bullet.VELOCITY_CONTROL,
                targetVelocity=0,
                force=float(torques[dof]),
                physicsClientId=self.client,
            )
        self.friction = torques.copy()

    def _load(self, model: mujoco.MjModel) -> None:
        bullet, client = self.bullet, self.client
        bullet.setGravity(*model.opt.gravity, physicsClientId=client)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=model.opt.timestep,
            constraintSolverType=bullet.CONSTRAINT_SOLVER_LCP_DANTZIG,
            warmStartingFactor=0.0,
            deterministicOverlappingPairs=1,
            useSplitImpulse=0,  # with it, joints more than 0.04 rad beyond a limit do not return
            physicsClientId=client,
        )
        export = to_urdf(model)
        self.robot = self._load_urdf(export.text)
        indices = self._map_joint_indices()
        names = [find_joint_name(model, joint) for joint in export.joints]
        self.joints = [indices[name] for name in names]
        self.geared = np.array(export.rotors, dtype=int)
        self.rotors = [indices[names[joint] + ROTOR] for joint in export.rotors]
        self.zero = model.qpos0.copy()
        self.driven = list(self.joints)
        for joint, rotor in zip(export.rotors, self.rotors, strict=True):
            self.driven[joint] = rotor
        for joint, rotor in zip(export.rotors, self.rotors, strict=True):
            self._add_gear(self.joints[joint], rotor)
        self._remove_defaults()
        self.set_friction(model.dof_frictionloss)
        self._add_planes(model)
        self._filter_collisions(model, indices)

    def _load_urdf(self, urdf: str) -> int:
        """Load a URDF text by a temporary file, because PyBullet reads files only."""
        bullet = self.bullet
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "model.urdf"
            file.write_text(urdf, encoding="utf-8")
            return int(
                bullet.loadURDF(
                    str(file),
                    useFixedBase=True,
                    flags=bullet.URDF_USE_INERTIA_FROM_FILE
                    | bullet.URDF_MAINTAIN_LINK_ORDER
                    | bullet.URDF_USE_SELF_COLLISION,
                    physicsClientId=self.client,
                )
            )

    def _map_joint_indices(self) -> dict[str, int]:
        count = self.bullet.getNumJoints(self.robot, physicsClientId=self.client)
        infos = [self.bullet.getJointInfo(self.robot, index, physicsClientId=self.client) for index in range(count)]
        return {info[1].decode(): info[0] for info in infos} | {f"link:{info[12].decode()}": info[0] for info in infos}

    def _add_gear(self, joint: int, rotor: int) -> None:
        """Couple a flywheel to its joint, one to one."""
        bullet, client = self.bullet, self.client
        gear = bullet.createConstraint(
            self.robot,
            joint,
            self.robot,
            rotor,
            bullet.JOINT_GEAR,
            [0, 0, 1],
            [0, 0, 0],
            [0, 0, 0],
            physicsClientId=client,
        )
        bullet.changeConstraint(gear, gearRatio=-1, maxForce=RIGID, physicsClientId=client)

    def _remove_defaults(self) -> None:
        """Remove the air drag and the default motor that PyBullet adds to every link and joint."""
        bullet, client = self.bullet, self.client
        for index in range(-1, bullet.getNumJoints(self.robot, physicsClientId=client)):
            bullet.changeDynamics(
                self.robot,
                index,
                linearDamping=0,
                angularDamping=0,
                jointDamping=0,
                maxJointVelocity=UNBOUNDED,
                physicsClientId=client,
            )
        for index in (*self.joints, *self.rotors):
            bullet.setJointMotorControl2(self.robot, index, bullet.VELOCITY_CONTROL, force=0, physicsClientId=client)

    def _add_planes(self, model: mujoco.MjModel) -> None:
        """Add the planes of the world body."""
        bullet, client = self.bullet, self.client
        self.planes = []
        for geom in range(model.body_geomadr[0], model.body_geomadr[0] + model.body_geomnum[0]):
            if model.geom_type[geom] != int(mujoco.mjtGeom.mjGEOM_PLANE):
                continue
            shape = bullet.createCollisionShape(bullet.GEOM_PLANE, planeNormal=[0, 0, 1], physicsClientId=client)
            w, x, y, z = model.geom_quat[geom]
            plane = bullet.createMultiBody(
                0,
                shape,
                basePosition=model.geom_pos[geom].tolist(),
                baseOrientation=[x, y, z, w],
                physicsClientId=client,
            )
            bullet.changeDynamics(
                plane, -1, lateralFriction=float(model.geom_friction[geom, 0]), physicsClientId=client
            )
            self.planes.append((geom, plane))

    def _filter_collisions(self, model: mujoco.MjModel, indices: dict[str, int]) -> None:
        """Enable exactly the collisions that MuJoCo enables."""
        links = {body: -1 if body == 0 else indices[f"link:{link_name(model, body)}"] for body in range(model.nbody)}
        for first in range(model.nbody):
            for second in range(first + 1, model.nbody):
                self._set_collision(self.robot, links[first], links[second], can_collide(model, first, second))
        for geom, plane in self.planes:
            for body in range(model.nbody):
                enabled = (
                    body > 0
                    and any(has_matching_contact_bits(model, geom, other) for other in list_geoms(model, body))
                    and model.body_weldid[body] != 0
                )
                self._set_collision(plane, -1, links[body], enabled)

    def _set_collision(self, other: int, other_link: int, link: int, enabled: bool) -> None:
        self.bullet.setCollisionFilterPair(
            other, self.robot, other_link, link, int(enabled), physicsClientId=self.client
        )


def disconnect(bullet: ModuleType, client: int) -> None:
    """Close a world; ignore that PyBullet may have closed it already at the interpreter's exit."""
    with contextlib.suppress(bullet.error):
        bullet.disconnect(physicsClientId=client)


def refuse_unsupported(model: mujoco.MjModel, name: str) -> None:
    """Refuse a model with elements that the export to PyBullet would drop; `name` is its name in errors.

    Raises:
        ModelFileError: names the elements.
    """
    soft = model.eq_active0.astype(bool) & (model.eq_solimp[:, 0] < SOFT)
    foreign = {
        "soft equality constraints": bool(soft.any()),
        "tendons with limits or friction": bool((model.tendon_limited | (model.tendon_frictionloss > 0)).any()),
        "ball or free joints": bool(
            np.isin(model.jnt_type, [mujoco.mjtJoint.mjJNT_BALL, mujoco.mjtJoint.mjJNT_FREE]).any()
        ),
        "flexible bodies": model.nflex > 0,
    }
    found = [what for what, present in foreign.items() if present]
    if found:
        raise ModelFileError(f"{name} has {' and '.join(found)}, which PyBullet is not given; use --engine mujoco.")


def list_geoms(model: mujoco.MjModel, body: int) -> range:
    """Return the indices of a body's geoms."""
    return range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])


def has_matching_contact_bits(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Whether contact types and affinities of two geoms match."""
    return bool(
        (model.geom_contype[first] & model.geom_conaffinity[second])
        | (model.geom_contype[second] & model.geom_conaffinity[first])
    )


def can_collide(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Whether two bodies can collide in MuJoCo: they have matching geoms and are neither neighbours nor excluded."""
    welds = [int(model.body_weldid[body]) for body in (first, second)]
    parents = [int(model.body_weldid[model.body_parentid[weld]]) for weld in welds]
    neighbours = welds[0] == welds[1] or (welds[0] == parents[1] != 0) or (welds[1] == parents[0] != 0)
    signature = (first << 16) + second
    excluded = signature in set(model.exclude_signature.tolist())
    matching = any(
        has_matching_contact_bits(model, a, b) for a in list_geoms(model, first) for b in list_geoms(model, second)
    )
    return matching and not neighbours and not excluded
