"""A teleoperator that needs no hand: it plays a command signal that touches neither the arm nor the floor."""

import time
from functools import cached_property

import numpy as np
from lerobot.teleoperators import Teleoperator
from lerobot.utils.errors import DeviceNotConnectedError

from lerobot_robot_ergojr.config_ergojr import ErgoJrExcitationConfig
from nas_data.dataset.features import make_position_feature
from nas_data.excitations.base import parse
from nas_data.hardware.xl320.joints import make_ergojr_joints
from nas_data.recorders.arm_plan import RETURN_SECONDS, MotionLimits, MotionPlan, draw_plan
from nas_data.recorders.session import PlaybackProtocol
from nas_data.robots.ergojr import JOINTS, RATE, ROBOT

POSITIONS = make_position_feature(JOINTS).names


class ErgoJrExcitation(Teleoperator):
    """Plays motions by the clock, one after the other with a rest between, from the first time that it is asked."""

    config_class = ErgoJrExcitationConfig
    name = "ergojr_excitation"

    def __init__(self, config: ErgoJrExcitationConfig) -> None:
        super().__init__(config)
        self.config = config
        self._commands: np.ndarray | None = None
        self._began: float | None = None

    @cached_property
    def action_features(self) -> dict[str, type]:
        """Names of what is commanded: `<joint>.pos`."""
        return dict.fromkeys(POSITIONS, float)

    @cached_property
    def feedback_features(self) -> dict[str, type]:
        """Nothing is fed back."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Whether the motions are drawn."""
        return self._commands is not None

    @property
    def is_calibrated(self) -> bool:
        """There is nothing to calibrate."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Draw the motions and try them in simulation.

        Raises:
            OptionError: there is no such signal, or nothing that touches nothing can be drawn.
        """
        config = self.config
        protocol = PlaybackProtocol(
            excitation=parse(config.excitation), episodes=config.motions, seconds=config.seconds, seed=config.seed
        )
        self._commands = in_a_row(draw_plan(ROBOT, protocol, MotionLimits(RATE, config.speed)))

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing."""

    def get_action(self) -> dict[str, float]:
        """Return the command [rad] of this moment, in whole ticks: what LeRobot stores is then what is sent."""
        if self._commands is None:
            raise DeviceNotConnectedError(f"{self} is not connected; call connect() first.")
        now = time.monotonic()
        self._began = now if self._began is None else self._began
        row = self._commands[int((now - self._began) * RATE) % len(self._commands)]
        return dict(zip(POSITIONS, row.tolist(), strict=True))

    def send_feedback(self, feedback: dict[str, float]) -> None:
        """Do nothing."""

    def disconnect(self) -> None:
        """Forget the motions."""
        self._commands = self._began = None


def in_a_row(plan: MotionPlan) -> np.ndarray:
    """Return a plan's episodes one after the other, each followed by its first pose, in whole ticks [rad], (T, n)."""
    rest = np.repeat(plan.poses[:, None], round(RETURN_SECONDS * RATE), axis=1)
    rows = np.concatenate([plan.commands, rest], axis=1).reshape(-1, plan.commands.shape[2])
    joints = make_ergojr_joints()
    return np.stack([joints.positions(joints.ticks(row)) for row in rows])
