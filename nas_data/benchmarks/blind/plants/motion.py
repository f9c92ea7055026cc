"""Motors and links in motion: the drives' torques, stopped by friction where it can, integrated in small steps."""

import numpy as np

from nas_data.benchmarks.blind.plants.servo_model import LEAD, REFRESH, STEP, SWEEPS, Drive
from nas_data.benchmarks.blind.plants.vectors import clip_symmetric

SUBSTEPS = round(REFRESH / STEP)


class PlantState:
    """What B arms remember: angles and speeds of links and motors, the servos' goals, friction torques.

    Attributes:
        q: Angles of the links [rad], shape (B, n).
        v: Speeds of the links [rad/s], shape (B, n).
    """

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
        self.q, self.v = q + self.ahead * v, v.copy()
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

    def state(self, joints: int) -> np.ndarray:
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
        """Return speeds after friction, which stops each joint or gives its whole budget.

        Args:
            free: Speeds without friction [rad/s], shape (B, n).
            mobility: Speed that a unit torque gives in this step, shape (B, n, n).
            budget: Largest friction torque [N m], shape (B, n).

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
