"""The drives of many arms: servo, friction that truly sticks, and a transmission with play or a spring."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from nas_data.benchmarks.blind.plants.numbers import Hideable, Servos
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

        Args:
            lead: Motor's minus link's angle [rad].
            rate: Its derivative [rad/s].
            inertia: What a link opposes to its own motor [kg m²].
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
