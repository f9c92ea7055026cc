"""Parameters of domain randomisation, and the limits of their draws."""

from dataclasses import asdict, dataclass

import mujoco
import numpy as np

Range = tuple[float, float]


@dataclass(frozen=True)
class Factors:
    """One draw of factors and added parameters.

    Attributes:
        mass: Factor of each body's mass and inertia, shape (nbody,).
        damping: Factor of each degree of freedom's damping, shape (nv,).
        friction: Factor of each degree of freedom's Coulomb friction, shape (nv,).
        armature: Factor of each degree of freedom's rotor inertia, shape (nv,).
        gain: Factor of each actuator's gain, shape (nu,).
        drag: Coulomb friction added in each joint, as a share of its actuator's largest torque, shape (n,).
        delay: Dead time of all commands [s].
    """

    mass: np.ndarray
    damping: np.ndarray
    friction: np.ndarray
    armature: np.ndarray
    gain: np.ndarray
    drag: np.ndarray
    delay: float


@dataclass(frozen=True)
class Ranges:
    """Limits of the draws. All of them include the source itself: factors of 1, no drag and no delay.

    Masses, damping and gain are those of OpenAI et al., Learning dexterous in-hand manipulation, 2018
    (arXiv:1808.00177, table 1), the delay that of Tan et al., Sim-to-real: learning agile locomotion for quadruped
    robots, 2018 (arXiv:1804.10332, table of randomised parameters). Friction has the limits of damping, and rotor
    inertia those of mass. Drag adds friction to motors that are frictionless in the source. The limits use no knowledge
    of the target. Backlash is left out, as in the usual recipes.

    Attributes:
        mass: Factor of mass and inertia, uniform.
        damping: Factor, log-uniform.
        friction: Factor, log-uniform.
        armature: Factor, uniform.
        gain: Factor, log-uniform.
        drag: Added Coulomb friction of each joint, as a share of its actuator's largest torque, uniform.
        delay: Dead time [s], uniform.
    """

    mass: Range = (0.5, 1.5)
    damping: Range = (0.3, 3.0)
    friction: Range = (0.3, 3.0)
    armature: Range = (0.5, 1.5)
    gain: Range = (0.75, 1.5)
    drag: Range = (0.0, 0.1)
    delay: Range = (0.0, 0.04)

    def draw(self, rng: np.random.Generator, model: mujoco.MjModel, joints: int) -> Factors:
        """Draw for one simulation.

        Args:
            rng: Source of randomness; same seed, same bits.
            model: Its model; each body, degree of freedom and actuator gets its own values.
            joints: Number of measured joints, n.
        """
        return Factors(
            mass=rng.uniform(*self.mass, model.nbody),
            damping=draw_log_uniform(rng, self.damping, model.nv),
            friction=draw_log_uniform(rng, self.friction, model.nv),
            armature=rng.uniform(*self.armature, model.nv),
            gain=draw_log_uniform(rng, self.gain, model.nu),
            drag=rng.uniform(*self.drag, joints),
            delay=float(rng.uniform(*self.delay)),
        )

    def describe(self) -> dict[str, object]:
        """Return the limits for JSON."""
        return {name: list(limits) for name, limits in asdict(self).items()}


def draw_log_uniform(rng: np.random.Generator, limits: Range, count: int) -> np.ndarray:
    """Draw log-uniform numbers between limits, shape (count,)."""
    low, high = limits
    return np.exp(rng.uniform(np.log(low), np.log(high), count))


NOMINAL = Ranges((1.0, 1.0), (1.0, 1.0), (1.0, 1.0), (1.0, 1.0), (1.0, 1.0), (0.0, 0.0), (0.0, 0.0))
RANGES = Ranges()
