"""A test double: joints that approach their commands like a first-order filter, with the ErgoJr's planar geometry."""

from dataclasses import dataclass, field

import numpy as np

JOINTS = ("m1", "m2", "m3", "m4", "m5", "m6")
RATE = 10.0  # [1/s] of approach, as PyBullet's default position control at 100 Hz
PERIOD = 0.01  # [s]
SHOULDER = np.array([0.0, 0.0375, 0.0590])  # [m] axis of m2


@dataclass
class FirstOrderArm:
    """Implements `Stepper` in a few lines of NumPy; `offset` [rad] is what the joints miss their commands by."""

    size: int
    offset: float = 0.0
    joints: tuple[str, ...] = JOINTS
    _states: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self._states = np.zeros((self.size, 2 * len(self.joints)))

    @property
    def states(self) -> np.ndarray:
        return self._states.copy()

    @property
    def objects(self) -> np.ndarray:
        return np.zeros((self.size, 0))

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        raise AssertionError("there are no objects")

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        self._states[slice(None) if rows is None else rows] = states

    def step(self, commands: np.ndarray) -> np.ndarray:
        n = len(self.joints)
        before = self._states[:, :n]
        after = before + RATE * PERIOD * (commands + self.offset - before)
        self._states = np.concatenate([after, (after - before) / PERIOD], axis=1)
        return self.states

    def set_states(self, states: np.ndarray) -> None:
        self._states = np.array(states, dtype=float)

    def site_positions(self, name: str) -> np.ndarray:
        """Tip in the plane x = 0: segments turn about x by the sums of m2, m3, m5 and m6; positive leans forward."""
        assert name == "tip"
        q = self._states
        angle = np.zeros(self.size)
        point = np.tile(SHOULDER, (self.size, 1))
        for joint, along, ahead in ((1, 0.054, 0.0), (2, 0.043, 0.048), (4, 0.0, 0.054), (5, 0.0, 0.030)):
            angle = angle + q[:, joint]
            point[:, 1] += along * np.sin(angle) + ahead * np.cos(angle)
            point[:, 2] += along * np.cos(angle) - ahead * np.sin(angle)
        return point
