"""Record episodes from any arm that LeRobot supports, or from a virtual one."""

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from nas_data.commands._record_arm import VIRTUAL, RecordArm
from nas_data.errors import OptionError

if TYPE_CHECKING:
    from nas_data.hardware.arms.base import Driver
    from nas_data.recorders.lerobot_robot import RobotRequest
    from nas_data.robots.base import Robot

LARGEST_JUMP = 0.2  # [rad] between two commands; these servos have no speed limit of their own
OWN = ("type", "port", "id", "option")  # options after --robot. that are read here


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """LeRobot's options of the robot."""

    type: str
    """LeRobot's robot, for example so101_follower, so100_follower or koch_follower."""
    port: str = ""
    """Serial port of the adapter; --port means the same."""
    id: str = ""
    """Name of this arm, which selects its calibration file; LeRobot's default if left out."""
    option: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Any other option of LeRobot's robot, KEY=VALUE; --robot.KEY=VALUE means the same. May be given several times."""


@dataclass(frozen=True, kw_only=True)
class RecordLerobot(RecordArm):
    """Record episodes from an arm that LeRobot supports; the same command resumes an interrupted recording.

    Calibrate the arm with lerobot-calibrate first. It moves slowly to its first pose: keep hands away. Ctrl-C stops the
    arm, holds it until it is slow and switches its torque off; it then sinks. Saved episodes are kept.

    Example: nas record lerobot --robot.type so101_follower --port virtual --episodes 3 --lockstep --name try
    """

    FASTEST: ClassVar[float] = 200.0  # [Hz] limit of six servos at 1 Mbit/s through a USB adapter

    robot: RobotOptions
    """Robot, with the options of LeRobot's own commands."""
    port: str = ""
    """Serial port, or 'virtual' for a simulated arm; --robot.port means the same."""
    model: str | None = None
    """Model for collision checks and for the motion of a virtual arm; the included model of this robot by default."""
    reverse: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A joint whose positive direction in LeRobot is opposite to the model's; may be given several times."""
    zero: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Model position of a joint at LeRobot's zero, JOINT=RADIANS; the middle of its range by default. May be given
    several times."""
    rate: float = 50.0
    """Control rate [Hz]."""
    speed: float = 2.0
    """Limit of the commands' speed [rad/s]: steps become ramps."""
    excitation: str = "multisine"
    """Command signal, NAME or NAME:PARAMETER=NUMBER,…, such as steps or ramps:every=20; a wrong NAME or PARAMETER is
    answered with those that exist."""
    episodes: int = 50
    """Number of episodes."""
    seconds: float = 6.0
    """Length of an episode [s]."""

    @classmethod
    def normalise_arguments(cls, arguments: list[str]) -> list[str]:
        """Convert LeRobot's other options, --robot.KEY=VALUE or --robot.KEY VALUE, to --robot.option KEY=VALUE."""
        spelt, rest = list[str](), iter(arguments)
        for word in rest:
            key, equals, value = word.removeprefix("--robot.").partition("=")
            if not word.startswith("--robot.") or key in OWN:
                spelt.append(word)
                continue
            spelt += ["--robot.option", f"{key}={value if equals else next(rest, '')}"]
        return spelt

    @property
    def kind(self) -> str:
        """Name of the robot in datasets."""
        return self.robot.type

    @property
    def virtual(self) -> bool:
        """Whether the arm is simulated."""
        return self._port == VIRTUAL

    @property
    def step(self) -> float:
        """Largest difference between successive commands [rad]."""
        if not 0 < self.speed < math.inf:
            raise OptionError(f"--speed is {self.speed:g}; it must be a number above zero.")
        if self.speed / self.rate > LARGEST_JUMP:
            least = math.ceil(self.speed / LARGEST_JUMP)
            raise OptionError(
                f"At --rate {self.rate:g} and --speed {self.speed:g} the arm would jump by "
                f"{self.speed / self.rate:.2g} rad between commands; give --rate {least} or more, or a lower --speed."
            )
        return self.speed / self.rate

    def arm_model(self) -> "Robot":
        """Return the model for collision checks."""
        from nas_data.recorders.lerobot_robot import default_model

        return default_model(self.robot.type, self.model)

    def driver(self) -> "AbstractContextManager[Driver]":
        """Return a context that yields the driver of the arm."""
        from nas_data.recorders.lerobot_robot import driver_of

        return driver_of(
            self._make_request(), self._port, self.effect, self.fault, self.lockstep, self.rate, self.speed
        )

    def simulated(self) -> str:
        """Return a phrase for the kind of virtual arm."""
        return f"virtual servos of a {self.robot.type}"

    @property
    def _port(self) -> str:
        port = self.port or self.robot.port
        if not port:
            raise OptionError(
                f"No port is given; give the arm's port, --robot.port PORT, or --port {VIRTUAL} for a simulated arm."
            )
        return port

    def _make_request(self) -> "RobotRequest":
        from nas_data.recorders.lerobot_robot import RobotRequest

        named = {"id": self.robot.id} if self.robot.id else {}
        return RobotRequest(
            kind=self.robot.type,
            options={**parse_pairs("--robot.option", self.robot.option), **named},
            model=self.arm_model(),
            reverse=self.reverse,
            zero={joint: parse_angle(joint, value) for joint, value in parse_pairs("--zero", self.zero).items()},
        )


def parse_pairs(option: str, texts: tuple[str, ...]) -> Mapping[str, str]:
    """Parse KEY=VALUE pairs.

    Raises:
        OptionError: a text is no such pair.
    """
    split = {text: text.partition("=") for text in texts}
    for text, (key, equals, _) in split.items():
        if not key or not equals:
            raise OptionError(f"{option} is '{text}'; write KEY=VALUE.")
    return {key: value for key, _, value in split.values()}


def parse_angle(joint: str, text: str) -> float:
    """Parse an angle [rad].

    Raises:
        OptionError: it is no number.
    """
    try:
        return float(text)
    except ValueError:
        raise OptionError(f"--zero {joint} is '{text}'; give radians (metres for a slide).") from None
