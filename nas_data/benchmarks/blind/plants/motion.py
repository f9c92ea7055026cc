"""Motion of links and motors under their drives, with true stiction, in small steps."""

import numpy as np

from nas_data.benchmarks.blind.plants.drive import STEP, Drive
from nas_data.benchmarks.blind.plants.vectors import clip_symmetric, shift

REFRESH = 1e-3  # [s] interval at which mass matrix and bias torques are updated
LEAD = (REFRESH - STEP) / 2  # [s] by which positions lead where a step of `REFRESH` adds the speed at its end
SWEEPS = 3  # iterations of the friction solver, which starts from the previous step's torques
SUBSTEPS = round(REFRESH / STEP)


class PlantState:
    """State of B arms: angles and speeds of links and motors, the servos' goals and warmth, friction torques."""

    def __init__(self, drive: Drive, commands: np.ndarray, period: float, starts: np.ndarray) -> None:
        """Set the initial state.

        Args:
            drive: Parameters of the drives.
            commands: Command of each drive in each control period [rad, N m], shape (B, T, n).
            period: Control period [s].
            starts: Angles [rad], then speeds [rad/s] of links and motors, shape (B, 2n).
        """
        q, v = np.split(starts, 2, axis=1)
        # a step adds the speed at its end; where torques are commanded, nothing corrects that lead
        self.ahead = STEP / 2 if drive.motors else 0.0
        self.drive = drive
        self.commands = self._clip_commands(commands)
        self.period = period
        self.q, self.v = q + self.ahead * v, v.copy()  # of the links [rad, rad/s], shape (B, n)
        self.earlier = self.v  # speeds at the previous refresh
        self.angle, self.speed = self.q.copy(), v.copy()
        self.goal = self.commands[:, 0].copy()
        self.goal_speed = np.zeros_like(q)
        self.wound = np.zeros_like(q)  # torque by the integrals of errors
        self.stopping = np.zeros_like(q)
        self.warmth = np.zeros_like(q)  # every episode begins with cold servos
        self.time = 0.0
        self.rigid = not drive.loose.any()
        self.prompt = not drive.delay.any()
        self.slews = bool((np.isfinite(drive.speed) | np.isfinite(drive.acceleration)).any())

    def set_commands(self, step: int, commands: np.ndarray) -> None:
        """Replace the commands of one control period, shape (B, n)."""
        self.commands[:, step] = self._clip_commands(commands[:, None])[:, 0]

    def middle(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the angles and speeds (B, n) for the mass matrix and bias torques of the next `REFRESH`.

        With servos, these are the present ones. Under commanded torques that would add energy to a swinging arm, so
        they are extrapolated to the middle of the interval.
        """
        if not self.drive.motors:
            return self.q, self.v
        return self.q + LEAD * self.v, self.v + (self.v - self.earlier) / 2

    def advance(self, mass: np.ndarray, bias: np.ndarray) -> None:
        """Advance by `REFRESH` with mass matrices (B, n, n) and bias torques (B, n)."""
        self.earlier = self.v
        diagonal = np.arange(mass.shape[-1])
        whole = mass.copy()
        whole[:, diagonal, diagonal] += self.drive.rigid_armature
        mobility = np.linalg.inv(whole)
        inertia = 1 / mobility[:, diagonal, diagonal]
        if self.time == 0:  # an arm at rest has been there for long
            self.wound = self.drive.limit_integral(bias - self.drive.pull(self.q))
        for _ in range(SUBSTEPS):
            self._step(mobility, inertia, bias)
            self.time += STEP

    def measure(self, rows: list[int]) -> np.ndarray:
        """Return angles [rad], then speeds [rad/s] of some links, shape (B, 2 rows)."""
        return np.concatenate([(self.q - self.ahead * self.v)[:, rows], self.v[:, rows]], axis=1)

    def _clip_commands(self, commands: np.ndarray) -> np.ndarray:
        """Return commands (B, T, n) within their ranges."""
        return np.clip(commands, self.drive.control[:, None, :, 0], self.drive.control[:, None, :, 1])

    def _step(self, mobility: np.ndarray, inertia: np.ndarray, bias: np.ndarray) -> None:
        drive, loose = self.drive, self.drive.loose
        angle = self.q if self.rigid else np.where(loose, self.angle, self.q)
        speed = self.v if self.rigid else np.where(loose, self.speed, self.v)
        pull, goal = drive.pull(self.q), self._compute_goal()
        if drive.is_geared_evenly:
            torque = self._drive(goal, angle, speed)
        else:
            *own, ratio = drive.gear(angle, speed, self.q, self.v)
            own_torque = self._drive(goal, *own)
            torque, pull = ratio * own_torque, pull - shift(drive.coupling * own_torque, -1)
        turning = torque + drive.passive(angle, speed)
        budget = drive.budget(torque, speed)
        on_link = turning + pull - bias
        held = budget
        if not self.rigid:
            carried = drive.transmitted(angle - self.q, speed - self.v, inertia)
            on_link = np.where(loose, carried + pull - bias, on_link)
            held = np.where(loose, 0.0, budget)
            self._turn_motors(turning - carried, budget, angle, speed)
        free = self.v + STEP * (mobility @ on_link[..., None])[..., 0]
        self.v = self._apply_friction(free, STEP * mobility, held)
        self.q = self.q + STEP * self.v

    def _drive(self, goal: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the drives' torques (B, n) [N m] at their own angles and speeds, and advance the integrals."""
        torque = self._weaken(self.drive.torque(goal, angle, speed, self.wound))
        if self.drive.is_integrating:
            self.wound = self.drive.wind(self.wound, goal, angle)
        return torque

    def _weaken(self, torque: np.ndarray) -> np.ndarray:
        """Return the torques (B, n) [N m] that warm servos on a sagging supply give in place of the wanted ones."""
        drive = self.drive
        if drive.is_always_strong:
            return torque
        given = torque / (1 + self.warmth + drive.drop(torque))
        self.warmth = self.warmth + STEP / drive.heat_time * (drive.heating(torque) - self.warmth)
        return np.asarray(given)

    def _turn_motors(self, torque: np.ndarray, budget: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> None:
        """Advance motors that move relative to their links; friction stops them if it can."""
        armature = np.where(self.drive.loose, self.drive.armature, 1.0)
        wanted = speed * armature / STEP + torque  # friction torque that would stop the motor in this step
        self.speed = STEP * (wanted - clip_symmetric(wanted, budget)) / armature
        self.angle = angle + STEP * self.speed

    def _apply_friction(self, free: np.ndarray, mobility: np.ndarray, budget: np.ndarray) -> np.ndarray:
        """Return link speeds after dry friction, by projected Gauss-Seidel, joint by joint.

        Args:
            free: Speeds without friction [rad/s], shape (B, n).
            mobility: Change of speed in this step by a unit torque, shape (B, n, n).
            budget: Largest friction torque [N m], shape (B, n).

        Returns:
            Speeds [rad/s], shape (B, n).
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

    def _compute_goal(self) -> np.ndarray:
        """Return the servos' goal [rad], shape (B, n): the delayed command, approached at a bounded rate."""
        # slightly later, so that a command counts in the step in which it is given
        if self.prompt:
            command = self.commands[:, int(self.time / self.period + 1e-6)]
        else:
            row = ((self.time - self.drive.delay) / self.period + 1e-6).astype(int)
            command = np.take_along_axis(self.commands, np.clip(row, 0, None)[:, None], axis=1)[:, 0]
        if not self.slews:
            return command
        self.goal_speed = self._compute_goal_speed(command - self.goal)
        self.goal = self.goal + STEP * self.goal_speed
        return self.goal

    def _compute_goal_speed(self, error: np.ndarray) -> np.ndarray:
        """Return the speeds (B, n) at which the goals approach commands that are `error` away [rad, N m].

        A goal with a limited acceleration is never faster than the speed from which it can stop at its command.
        """
        wanted = clip_symmetric(error / STEP, self.drive.speed)
        ramped = np.isfinite(self.drive.acceleration)
        if not ramped.any():
            return wanted
        rate = np.where(ramped, self.drive.acceleration, 0.0)
        wanted = np.where(ramped, clip_symmetric(wanted, np.sqrt(2 * rate * np.abs(error))), wanted)
        return np.where(ramped, self.goal_speed + clip_symmetric(wanted - self.goal_speed, rate * STEP), wanted)
