"""Drives and links in motion: servo, friction that truly sticks, transmission; integrated in small steps."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from nas_data.benchmarks.blind.plants.constants import Hideable, Servos
from nas_data.benchmarks.blind.plants.vectors import clip_symmetric

STEP = 2.5e-4  # [s] physics step of the drives
REFRESH = 1e-3  # [s] for which mass matrix and bias torques are held
LEAD = (REFRESH - STEP) / 2  # [s] by which positions run ahead where a step of `REFRESH` adds the speed at its end
SWEEPS = 3  # of the friction solver; it starts from the step before, so the torques are settled
SPRING_LOSS = 1e-3  # [s] damping over stiffness of an elastic transmission, as the contract's effect has it
STOP_RATE = 0.3 / STEP  # [rad/s] frequency of a link on the flank of its gear: as stiff as the step resolves
FLANK_LOSS = 1.4  # twice the damping ratio of a tooth that hits its flank


@dataclass
class Drive(Hideable, Servos):
    """Numbers of n drives in B arms, each of shape (B, n) but `force` and `control`, (B, n, 2)."""

    @classmethod
    def of(cls, numbers: dict[str, np.ndarray]) -> "Drive":
        """Take what concerns the drives from the stacked numbers of the arms."""
        return cls(**{field.name: numbers[field.name] for field in fields(cls)})

    @cached_property
    def loose(self) -> np.ndarray:
        """Whether motor and link turn apart."""
        return np.asarray((self.play > 0) | np.isfinite(self.spring))

    @cached_property
    def motors(self) -> bool:
        """Whether torques are commanded: nothing then pulls a position back that a coarse integration let drift."""
        return bool(self.motor.any())

    @cached_property
    def is_dry_friction_constant(self) -> bool:
        """Whether dry friction depends on nothing; asked in every step."""
        return not (self.stribeck.any() or self.load_ratio.any())

    @cached_property
    def rigid_armature(self) -> np.ndarray:
        """Rotor inertia that the link feels at once [kg m²]."""
        return np.where(self.loose, 0.0, self.armature)

    def torque(self, goal: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the drive's torque [N m]: of a servo position gain outside the dead band, own damping; saturation."""
        error = goal + self.offset - angle
        felt = error - clip_symmetric(error, self.deadband)
        wanted = self.gain * felt - self.servo_damping * speed + self.motor * goal
        return np.asarray(np.minimum(np.maximum(wanted, self.force[..., 0]), self.force[..., 1]))

    def passive(self, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return what else turns the motor, dry friction aside [N m]: damping and cogs."""
        losses = -(self.damping + self.viscous) * speed
        if not self.cogs.any():
            return losses
        return losses + self.cogs * np.sin(self.cog_count * angle + self.cog_phase)

    def budget(self, torque: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the largest torque of dry friction [N m]; models M1, M2 and M3 of Rhoban/bam."""
        if self.is_dry_friction_constant:
            return self.friction
        falling = self.kinetic_ratio + (1 - self.kinetic_ratio) * np.exp(-((speed / self.stribeck_velocity) ** 2))
        return np.asarray(self.friction + self.stribeck * falling + self.load_ratio * np.abs(torque))

    def pull(self, q: np.ndarray) -> np.ndarray:
        """Return the cables' torque on the links [N m]: none beyond the angle at which a cable hangs loose."""
        stretch = self.cable_side * (q - self.cable_angle)
        return np.asarray(-self.cable_side * self.cable * np.maximum(stretch, 0))

    def transmitted(self, lead: np.ndarray, rate: np.ndarray, inertia: np.ndarray) -> np.ndarray:
        """Return the torque from motor to link where they turn apart [N m].

        It depends on the motor's lead over the link [rad] with its rate [rad/s], and on the inertia that a link opposes
        to its own motor [kg m²].
        """
        beyond = lead - clip_symmetric(lead, self.play)
        flank = np.minimum(self.flank, np.minimum(inertia, self.armature) * STOP_RATE**2)
        elastic = np.isfinite(self.spring)
        stiffness = np.where(elastic, np.where(elastic, self.spring, 0), flank)
        loss = np.where(elastic, SPRING_LOSS * stiffness, FLANK_LOSS * np.sqrt(stiffness * inertia))
        torque = stiffness * beyond + loss * rate
        # teeth push and never pull; a spring does both
        pushing = np.where(beyond > 0, np.maximum(torque, 0), np.where(beyond < 0, np.minimum(torque, 0), 0))
        return np.where(elastic, torque, pushing)


SUBSTEPS = round(REFRESH / STEP)


class PlantState:
    """What B arms remember: angles and speeds of links and motors, the servos' goals, friction torques."""

    def __init__(self, drive: Drive, commands: np.ndarray, period: float, starts: np.ndarray) -> None:
        """Put the arms where they start.

        Args:
            drive: Numbers of the drives.
            commands: What each drive is told in each control period [rad, N m], shape (B, T, n).
            period: Control period [s].
            starts: Angles [rad], then speeds [rad/s] of links and motors, shape (B, 2n).
        """
        q, v = np.split(starts, 2, axis=1)
        # a step adds the speed at its end; nothing takes that back where torques are commanded
        self.ahead = STEP / 2 if drive.motors else 0.0
        self.drive = drive
        self.commands = self._clip_commands(commands)
        self.period = period
        self.q, self.v = q + self.ahead * v, v.copy()  # of the links [rad, rad/s], shape (B, n)
        self.earlier = self.v  # a refresh ago
        self.angle, self.speed = self.q.copy(), v.copy()
        self.goal = self.commands[:, 0].copy()
        self.stopping = np.zeros_like(q)
        self.time = 0.0
        self.rigid = not drive.loose.any()
        self.prompt = not drive.delay.any()
        self.slews = bool(np.isfinite(drive.speed).any())

    def tell(self, step: int, commands: np.ndarray) -> None:
        """Replace the commands of one control period, shape (B, n)."""
        self.commands[:, step] = self._clip_commands(commands[:, None])[:, 0]

    def middle(self) -> tuple[np.ndarray, np.ndarray]:
        """Return angles and speeds (B, n) at which mass matrix and bias torques of the next `REFRESH` are to be taken.

        For servos they are those of its beginning. Under commanded torques that would push a swinging arm on: there
        they are those of its middle, extrapolated.
        """
        if not self.drive.motors:
            return self.q, self.v
        return self.q + LEAD * self.v, self.v + (self.v - self.earlier) / 2

    def advance(self, mass: np.ndarray, bias: np.ndarray) -> None:
        """Move on by `REFRESH` with mass matrices (B, n, n) and bias torques (B, n)."""
        self.earlier = self.v
        diagonal = np.arange(mass.shape[-1])
        whole = mass.copy()
        whole[:, diagonal, diagonal] += self.drive.rigid_armature
        mobility = np.linalg.inv(whole)
        inertia = 1 / mobility[:, diagonal, diagonal]
        for _ in range(SUBSTEPS):
            self._step(mobility, inertia, bias)
            self.time += STEP

    def measure(self, joints: int) -> np.ndarray:
        """Return angles [rad], then speeds [rad/s] of the first joints' links: (B, 2 joints)."""
        return np.concatenate([(self.q - self.ahead * self.v)[:, :joints], self.v[:, :joints]], axis=1)

    def _clip_commands(self, commands: np.ndarray) -> np.ndarray:
        """Return commands (B, T, n) within their ranges."""
        return np.clip(commands, self.drive.control[:, None, :, 0], self.drive.control[:, None, :, 1])

    def _step(self, mobility: np.ndarray, inertia: np.ndarray, bias: np.ndarray) -> None:
        drive, loose = self.drive, self.drive.loose
        angle = self.q if self.rigid else np.where(loose, self.angle, self.q)
        speed = self.v if self.rigid else np.where(loose, self.speed, self.v)
        torque = drive.torque(self._goal(), angle, speed)
        turning = torque + drive.passive(angle, speed)
        budget = drive.budget(torque, speed)
        on_link = turning + drive.pull(self.q) - bias
        held = budget
        if not self.rigid:
            carried = drive.transmitted(angle - self.q, speed - self.v, inertia)
            on_link = np.where(loose, carried + drive.pull(self.q) - bias, on_link)
            held = np.where(loose, 0.0, budget)
            self._turn_motors(turning - carried, budget, angle, speed)
        free = self.v + STEP * (mobility @ on_link[..., None])[..., 0]
        self.v = self._apply_friction(free, STEP * mobility, held)
        self.q = self.q + STEP * self.v

    def _turn_motors(self, torque: np.ndarray, budget: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> None:
        """Move motors that turn apart from their links; friction stops them if it can."""
        armature = np.where(self.drive.loose, self.drive.armature, 1.0)
        wanted = speed * armature / STEP + torque  # the torque that friction needs to stop the motor in this step
        self.speed = STEP * (wanted - clip_symmetric(wanted, budget)) / armature
        self.angle = angle + STEP * self.speed

    def _apply_friction(self, free: np.ndarray, mobility: np.ndarray, budget: np.ndarray) -> np.ndarray:
        """Return speeds (B, n) [rad/s] after friction, which stops each joint or gives its whole budget (B, n) [N m].

        The speeds without friction are (B, n), the mobility, speed that a unit torque gives in this step, is (B, n, n);
        projected Gauss-Seidel, joint by joint.

        Returns:
            Speeds [rad/s], shape (B, n); projected Gauss-Seidel, joint by joint.
        """
        if not budget.any():
            return free
        torque = clip_symmetric(self.stopping, budget)
        speed = free - (mobility @ torque[..., None])[..., 0]
        for _ in range(SWEEPS):
            for joint in range(free.shape[1]):
                limit = budget[:, joint]
                wanted = torque[:, joint] + speed[:, joint] / mobility[:, joint, joint]
                change = clip_symmetric(wanted, limit) - torque[:, joint]
                torque[:, joint] += change
                speed -= mobility[:, :, joint] * change[:, None]
        self.stopping = torque
        return speed

    def _goal(self) -> np.ndarray:
        """Return where the servos try to be [rad]: the command of a moment ago, approached at a bounded rate."""
        # a hair later, so that a command counts from the very step in which it is given
        if self.prompt:
            told = self.commands[:, int(self.time / self.period + 1e-6)]
        else:
            row = ((self.time - self.drive.delay) / self.period + 1e-6).astype(int)
            told = np.take_along_axis(self.commands, np.clip(row, 0, None)[:, None], axis=1)[:, 0]
        if not self.slews:
            return told
        way = self.drive.speed * STEP
        self.goal = self.goal + clip_symmetric(told - self.goal, way)
        return self.goal
