"""The options of robot and teleoperator, under the names that LeRobot's commands know them by."""

from dataclasses import dataclass

from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig


@RobotConfig.register_subclass("ergojr")
@dataclass(kw_only=True)
class ErgoJrConfig(RobotConfig):
    """An ErgoJr on a port.

    Attributes:
        port: Serial port of the adapter; `virtual` for simulated servos.
        id: Name of this very arm, which names its calibration file.
        max_step: By how much a command may differ from the one before it [rad].
        speed: Speed limit in the servos [rad/s]; 0 for none.
        torque: Torque limit in the servos, a share of the largest.
        patience: Time [s] without a word from LeRobot after which the torque is switched off.
    """

    port: str
    id: str | None = "ergojr"
    max_step: float = 3.2
    speed: float = 1.745
    torque: float = 1.0
    patience: float = 30.0


@TeleoperatorConfig.register_subclass("ergojr_excitation")
@dataclass(kw_only=True)
class ErgoJrExcitationConfig(TeleoperatorConfig):
    """A command signal that is played instead of a hand.

    Attributes:
        excitation: Signal, `NAME` or `NAME:PARAMETER=NUMBER,…`, as `nas record ergojr` takes it.
        motions: Stretches of the signal that are drawn; after the last comes the first again.
        seconds: Length of each [s]; after it the arm goes back to rest for two seconds.
        seed: Seed of the signal.
        speed: Speed limit of the servos [rad/s], with which the motions are tried in simulation.
    """

    excitation: str = "steps"
    motions: int = 20
    seconds: float = 3.0
    seed: int = 0
    speed: float = 1.745
