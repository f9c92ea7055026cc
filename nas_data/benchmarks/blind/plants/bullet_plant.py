"""A plant in PyBullet: its dynamics and integration, with our servos, friction and transmissions."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from nas_data.benchmarks.blind.plants.base import Play, make_simulation
from nas_data.benchmarks.blind.plants.hiding import PlantBody
from nas_data.benchmarks.blind.plants.motion import LEAD, REFRESH, PlantState
from nas_data.simulators.bullet_world import import_pybullet, silence

UNBOUNDED = 1e5  # [rad/s] in place of PyBullet's speed limit of 100 rad/s, which is not physical


@contextmanager
def open_worlds(
    bodies: list[PlantBody], numbers: dict[str, np.ndarray], state: PlantState
) -> Iterator[Callable[[], None]]:
    """Yield a function that advances all arms by `REFRESH`, as `OpenPhysics` requires."""
    at = np.split(np.concatenate([state.q, state.v], axis=1), len(bodies))
    with ExitStack() as stack:
        worlds = [stack.enter_context(BulletArms(body, rows)) for body, rows in zip(bodies, at, strict=True)]
        yield lambda: move(state, worlds)


play = Play(make_simulation(open_worlds))


def move(state: PlantState, worlds: "list[BulletArms]") -> None:
    """Advance by `REFRESH`: the drives in small steps, then each world once with their mean torques."""
    mass, bias = concatenate_pairs([world.dynamics(world.v) for world in worlds])
    before, (_, middle) = state.v, state.middle()
    if state.drive.motors:
        speeds = np.split(middle, len(worlds))
        state.advance(*concatenate_pairs([world.dynamics(part) for world, part in zip(worlds, speeds, strict=True)]))
    else:
        state.advance(mass, bias)
    # mean torque of the drives on the links, without that on the rotors, which PyBullet does not model
    torques = (mass @ ((state.v - before) / REFRESH)[..., None])[..., 0] + bias
    parts = np.split(torques, len(worlds))
    state.q, state.v = concatenate_pairs([world.step(part) for world, part in zip(worlds, parts, strict=True)])


def concatenate_pairs(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Concatenate pairs of arrays."""
    first, second = zip(*parts, strict=True)
    return np.concatenate(first), np.concatenate(second)


class BulletArms:
    """One arm per episode in one PyBullet world, without collisions."""

    def __init__(self, body: PlantBody, starts: np.ndarray) -> None:
        """Load the arms in their initial states: angles [rad], then speeds [rad/s], shape (E, 2n).

        Raises:
            MissingPackage: PyBullet is not installed.
        """
        self.bullet = import_pybullet()
        self.joints = list(range(len(body.masses)))
        angles, self.v = np.split(starts, 2, axis=1)
        self.q = angles + LEAD * self.v  # PyBullet's positions, which lead
        with silence():
            self.client = self.bullet.connect(self.bullet.DIRECT)
            self.bullet.setGravity(*body.gravity.tolist(), physicsClientId=self.client)
            self.bullet.setPhysicsEngineParameter(fixedTimeStep=REFRESH, physicsClientId=self.client)
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "arm.urdf"
                file.write_text(to_urdf(body), encoding="utf-8")
                both = zip(self.q.tolist(), self.v.tolist(), strict=True)
                self.arms = [self._load(str(file), *row) for row in both]

    def __enter__(self) -> "BulletArms":
        return self

    def __exit__(self, *_: object) -> None:
        self.bullet.disconnect(physicsClientId=self.client)

    def dynamics(self, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mass matrices (E, n, n) and bias torques (E, n) at the present positions and at speeds (E, n)."""
        bullet, client, still = self.bullet, self.client, [0.0] * len(self.joints)
        mass, bias = [], []
        for arm, angles, rates in zip(self.arms, self.q.tolist(), speeds.tolist(), strict=True):
            mass.append(bullet.calculateMassMatrix(arm, angles, physicsClientId=client))
            bias.append(bullet.calculateInverseDynamics(arm, angles, rates, still, physicsClientId=client))
        return np.array(mass), np.array(bias)

    def step(self, torques: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Apply joint torques (E, n) [N m] for one step.

        Returns:
            Angles [rad], corrected for the lead, and speeds [rad/s], shape (E, n) each.
        """
        bullet, client = self.bullet, self.client
        for arm, row in zip(self.arms, torques.tolist(), strict=True):
            bullet.setJointMotorControlArray(
                arm, self.joints, bullet.TORQUE_CONTROL, forces=row, physicsClientId=client
            )
        bullet.stepSimulation(physicsClientId=client)
        states = [bullet.getJointStates(arm, self.joints, physicsClientId=client) for arm in self.arms]
        values = np.array([[state[:2] for state in row] for row in states])
        self.q, self.v = values[..., 0], values[..., 1]
        return self.q - LEAD * self.v, self.v

    def _load(self, file: str, angles: list[float], speeds: list[float]) -> int:
        """Load one arm without motors, damping and shapes."""
        bullet, client = self.bullet, self.client
        arm = int(
            bullet.loadURDF(file, useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
        )
        free = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0, "maxJointVelocity": UNBOUNDED}
        for joint, (angle, speed) in enumerate(zip(angles, speeds, strict=True)):
            bullet.changeDynamics(arm, joint, **free, physicsClientId=client)
            bullet.setJointMotorControl2(arm, joint, bullet.VELOCITY_CONTROL, force=0, physicsClientId=client)
            bullet.resetJointState(arm, joint, angle, speed, physicsClientId=client)
        return arm


def to_urdf(body: PlantBody) -> str:
    """Write an arm as URDF: link 0 is the fixed base, joint k carries link k; no shapes, no limits, no rotors."""
    parts = ['<robot name="arm">', format_link(0, 0.0, np.zeros(3), np.zeros((3, 3)))]
    for row in range(len(body.masses)):
        parts.append(format_link(row + 1, body.masses[row], body.centres[row], body.inertias[row]))
        parts.append(format_joint(row + 1, body, row))
    return "\n".join([*parts, "</robot>"])


def format_link(number: int, mass: float, centre: np.ndarray, inertia: np.ndarray) -> str:
    """Write a link with its mass [kg], centre of mass [m] and inertia about it [kg m²], turned to principal axes."""
    moments, axes = np.linalg.eigh(inertia)
    axes = axes * np.sign(np.linalg.det(axes))  # a rotation, not a mirror
    ixx, iyy, izz = (repr(float(moment)) for moment in moments)
    return (
        f'<link name="l{number}"><inertial>{format_origin(centre, axes)}<mass value="{float(mass)!r}"/>'
        f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def format_joint(number: int, body: PlantBody, row: int) -> str:
    """Write the hinge or slide that carries a link; a lower limit above the upper one means no limit."""
    kind = "prismatic" if body.sliding[row] else "continuous"
    limit = '<limit lower="1" upper="-1" effort="0" velocity="0"/>' if body.sliding[row] else ""
    return (
        f'<joint name="q{number}" type="{kind}"><parent link="l{number - 1}"/><child link="l{number}"/>'
        f"{format_origin(body.offsets[row], body.turns[row])}"
        f'<axis xyz="{format_numbers(body.axes[row])}"/>{limit}</joint>'
    )


def format_origin(place: np.ndarray, turn: np.ndarray) -> str:
    """Write a place [m] and a rotation matrix as URDF's roll, pitch and yaw about fixed axes."""
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = np.arctan2(-turn[2, 0], level)
    if level > 1e-9:
        roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    else:  # gimbal lock: only the difference of roll and yaw is determined
        roll, yaw = np.arctan2(-turn[1, 2], turn[1, 1]), 0.0
    return f'<origin xyz="{format_numbers(place)}" rpy="{format_numbers(np.array([roll, pitch, yaw]))}"/>'


def format_numbers(values: np.ndarray) -> str:
    """Return numbers that read back as the same doubles."""
    return " ".join(repr(float(value)) for value in values)
