"""Dynamics of the drives: servo, friction with true stiction, transmission; integrated in small steps."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from nas_data.benchmarks.blind.plants.constants import Hideable, Servos
from nas_data.benchmarks.blind.plants.vectors import clip_symmetric

STEP = 2.5e-4  # [s] physics step of the drives
REFRESH = 1e-3  # [s] interval at which mass matrix and bias torques are updated
LEAD = (REFRESH - STEP) / 2  # [s] by which positions lead where a step of `REFRESH` adds the speed at its end
SWEEPS = 3  # iterations of the friction solver, which starts from the previous step's torques
SPRING_LOSS = 1e-3  # [s] damping over stiffness of an elastic transmission, as the contract's effect has it
STOP_RATE = 0.3 / STEP  # [rad/s] natural frequency of a link on its gear's flank: as stiff as the step resolves
FLANK_LOSS = 1.4  # twice the damping ratio of a tooth that hits its flank
PUNCH_WIDTH = np.radians(0.03)  # error at which a servo's least torque is reached: a fraction of a sensor's step


@dataclass
class Drive(Hideable, Servos):
    """Parameters of n drives in B arms, shape (B, n); `force` and `control` are (B, n, 2)."""

    @classmethod
    def of(cls, numbers: dict[str, np.ndarray]) -> "Drive":
        """Select the drives' parameters from the stacked constants of the arms."""
        return cls(**{field.name: numbers[field.name] for field in fields(cls)})

    @cached_property
    def loose(self) -> np.ndarray:
        """Whether motor and link can move relative to each other, shape (B, n)."""
        return np.asarray((self.play > 0) | np.isfinite(self.spring))

    @cached_property
    def motors(self) -> bool:
        """Whether torques are commanded: no servo then corrects the drift of a coarse integration."""
        return bool(self.motor.any())

    @cached_property
    def is_dry_friction_constant(self) -> bool:
        """Whether dry friction depends neither on torque nor on speed; cached because every step needs it."""
        return not (self.stribeck.any() or self.load_ratio.any())

    @cached_property
    def rigid_armature(self) -> np.ndarray:
        """Rotor inertia of drives that are rigidly coupled to their link, else 0 [kg m²], shape (B, n)."""
        return np.where(self.loose, 0.0, self.armature)

    def torque(self, goal: np.ndarray, angle: np.ndarray, speed: np.ndarray, wound: np.ndarray) -> np.ndarray:
        """Return the drive's torque [N m], (B, n); a servo's: gain outside the dead band, less damping, saturated.

        Args:
            goal: Goals of servos [rad], commands of motors [N m], shape (B, n).
            angle: Of the motors [rad], shape (B, n).
            speed: Of the motors [rad/s], shape (B, n).
            wound: Torque by the integral of the servos' errors [N m], shape (B, n).
        """
        error = goal + self.offset - angle
        felt = error - clip_symmetric(error, self.deadband)
        pulled = self.gain * felt
        if self.has_punch:
            least = self.punch * np.clip(felt / PUNCH_WIDTH, -1, 1)
            pulled = np.where(np.abs(least) > np.abs(pulled), least, pulled)
        wanted = pulled + wound - self.servo_damping * speed + self.motor * goal
        lowest, highest = self.force[..., 0], self.force[..., 1]
        if self.has_curve:
            lowest = np.maximum(lowest, -self.stall - self.back_emf * np.minimum(speed, 0))
            highest = np.minimum(highest, self.stall - self.back_emf * np.maximum(speed, 0))
        return np.asarray(np.minimum(np.maximum(wanted, lowest), highest))

    @cached_property
    def has_punch(self) -> bool:
        """Whether a servo has a least torque."""
        return bool(self.punch.any())

    @cached_property
    def has_curve(self) -> bool:
        """Whether a torque limit falls with speed."""
        return bool(self.back_emf.any())

    @cached_property
    def is_integrating(self) -> bool:
        """Whether a servo integrates its error."""
        return bool(self.integral.any())

    def wind(self, wound: np.ndarray, goal: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Return the torques by the integrals [N m] one step later, shape (B, n); arguments as for `torque`."""
        more = wound + STEP * self.integral * (goal + self.offset - angle)
        return self.limit_integral(more)

    def limit_integral(self, torque: np.ndarray) -> np.ndarray:
        """Return torques (B, n) [N m] of integrals within the torque limits; zero without an integral gain."""
        inside = np.minimum(np.maximum(torque, self.force[..., 0]), self.force[..., 1])
        return np.where(self.integral > 0, inside, 0.0)

    @cached_property
    def is_geared_evenly(self) -> bool:
        """Whether every servo turns with its own joint only, and as much."""
        return not (self.eccentric.any() or self.coupling.any())

    @cached_property
    def is_always_strong(self) -> bool:
        """Whether neither heat nor the supply weakens a drive."""
        return not (self.heat_rise.any() or self.sag.any())

    def gear(
        self, angle: np.ndarray, speed: np.ndarray, q: np.ndarray, v: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the servos' angles, speeds and torque ratios behind eccentric gears and belts.

        servo angle = angle − A sin(count · angle + phase) − c · angle of the joint before. By virtual work, the torque
        on the joint is the servo's times the derivative of this angle; that on the joint before is −c times it.

        Args:
            angle: Of the motors [rad], shape (B, n).
            speed: Of the motors [rad/s], shape (B, n).
            q: Angles of the links [rad], shape (B, n).
            v: Speeds of the links [rad/s], shape (B, n).
        """
        turn = self.eccentric_count * angle + self.eccentric_phase
        ratio = 1 - self.eccentric * self.eccentric_count * np.cos(turn)
        moved, moving = (self.coupling * shift(values, 1) for values in (q, v))
        return angle - self.eccentric * np.sin(turn) - moved, ratio * speed - moving, ratio

    def drop(self, torque: np.ndarray) -> np.ndarray:
        """Return the relative loss of supply voltage at each drive, shape (B, n), by the torques of the others."""
        load = np.abs(torque)
        return np.asarray(self.sag * (load.sum(axis=1, keepdims=True) - load))

    def heating(self, torque: np.ndarray) -> np.ndarray:
        """Return the warmth that a lasting torque [N m] ends at, shape (B, n): copper loss grows with its square."""
        limit = np.where(self.heat_rise > 0, self.force[..., 1], 1.0)
        return np.asarray(self.heat_rise * (torque / limit) ** 2)

    def passive(self, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return damping, cogging torque and uneven part of the friction on the motor [N m], shape (B, n)."""
        losses = -(self.damping + self.viscous) * speed - self.uneven
        if not self.cogs.any():
            return losses
        return losses + self.cogs * np.sin(self.cog_count * angle + self.cog_phase)

    def budget(self, torque: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return the largest torque of dry friction [N m], shape (B, n); models M1, M2 and M3 of Rhoban/bam."""
        if self.is_dry_friction_constant:
            return self.friction
        falling = self.kinetic_ratio + (1 - self.kinetic_ratio) * np.exp(-((speed / self.stribeck_velocity) ** 2))
        return np.asarray(self.friction + self.stribeck * falling + self.load_ratio * np.abs(torque))

    def pull(self, q: np.ndarray) -> np.ndarray:
        """Return the cables' torque on the links [N m], shape (B, n); zero where a cable is slack."""
        stretch = self.cable_side * (q - self.cable_angle)
        return np.asarray(-self.cable_side * self.cable * np.maximum(stretch, 0))

    def transmitted(self, lead: np.ndarray, rate: np.ndarray, inertia: np.ndarray) -> np.ndarray:
        """Return the torque from motor to link through an elastic transmission or play [N m], shape (B, n).

        Args:
            lead: Motor angle minus link angle [rad], shape (B, n).
            rate: Its derivative [rad/s], shape (B, n).
            inertia: Inertia that each link opposes to its own motor [kg m²], shape (B, n).
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


def shift(values: np.ndarray, joints: int) -> np.ndarray:
    """Move values (B, n) by one joint towards the tip (1) or the base (−1); zeros come in."""
    moved = np.zeros_like(values)
    if joints > 0:
        moved[:, 1:] = values[:, :-1]
    else:
        moved[:, :-1] = values[:, 1:]
    return moved


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
