"""Torques of the drives: servo or motor, losses, friction and transmission."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from nas_data.benchmarks.blind.plants.constants import Hideable, Servos
from nas_data.benchmarks.blind.plants.vectors import clip_symmetric, shift

STEP = 2.5e-4  # [s] physics step of the drives
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
