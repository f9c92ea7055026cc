"""Setup of one or two ErgoJr arms for rollouts: checks of the task, control of the arms, and their source of hits."""

import os
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

import numpy as np

from nas_data.envs.base import Task
from nas_data.envs.ergo_shield import ErgoShield, detect_touches
from nas_data.errors import OptionError
from nas_data.policies.rollouts.robot_stepper import LOOKAHEAD, RobotStepper, RolloutTally
from nas_data.policies.rollouts.two_arm_planner import Approach, TwoArmPlanner, make_two_arm_planner
from nas_data.recorders.arm_motion import ArmMotion
from nas_data.recorders.guarded import GuardedArm, Setup
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.schedule import Clock
from nas_data.robots.base import find_robot
from nas_data.robots.ergojr import JOINTS
from nas_data.simulators.base import Stepper

# Linux, include/uapi/linux/input.h and input-event-codes.h
EVENT = struct.Struct("llHHi")  # seconds, microseconds, type, code, value
KEY_EVENT, KEY_S = 1, 31  # the authors' MakeyMakey sends an "s"
RELEASED = 0  # value of an event; 1 is pressed, 2 repeated
EVENTS = 64  # read at once


class Keyboard:
    """The key of a MakeyMakey, pressed while sword and shield (in conductive paint) touch; a context manager."""

    def __init__(self, path: str) -> None:
        """Open an input device.

        Raises:
            OptionError: there is no such device, or the user may not read it.
        """
        try:
            self._descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except PermissionError:
            raise OptionError(
                f"{path} may not be read by this user; join its group (sudo usermod -aG input $USER) and log in again."
            ) from None
        except OSError as error:
            raise OptionError(
                f"{path} cannot be read as a keyboard ({(error.strerror or str(error)).lower()}); give --hits one of: "
                f"{list_keyboards()}."
            ) from None
        self._path, self._held = path, False

    def __call__(self, stepper: Stepper) -> np.ndarray:
        """Return whether the key was pressed since the last call or still is, shape (1,).

        Raises:
            OptionError: the device is gone.
        """
        pressed = self._held
        for kind, code, value in self._read_events():
            if (kind, code) == (KEY_EVENT, KEY_S):
                self._held = value != RELEASED
                pressed |= self._held
        return np.array([pressed])

    def _read_events(self) -> list[tuple[int, int, int]]:
        """Return type, code and value of the new events."""
        try:
            content = os.read(self._descriptor, EVENTS * EVENT.size)
        except BlockingIOError:
            return []
        except OSError:
            raise OptionError(f"{self._path} vanished while it was read; plug the MakeyMakey in again.") from None
        whole = content[: len(content) // EVENT.size * EVENT.size]
        return [event[2:] for event in EVENT.iter_unpack(whole)]

    def __enter__(self) -> "Keyboard":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._descriptor)


def list_keyboards() -> str:
    """Return the available keyboards as a list for a sentence."""
    found = sorted(str(path) for path in Path("/dev/input/by-id").glob("*-kbd"))
    return ", ".join([*found, "simulated"])


ARM = "ergojr_penholder"  # model of a single arm
NO_LOAD_SPEED = 11.9  # [rad/s] at 7.4 V, XL-320 e-manual (114 rpm)
CLEARANCE = 0.01  # [m] preferred distance of two arms on slow paths: friction leaves joint errors of up to 5°
SIMULATED = "simulated"


@dataclass(frozen=True, kw_only=True)
class ArmSetup:
    """The arms on the table."""

    attacker: Setup  # the arm that the policy commands
    defender: Setup | None  # the second arm; None if the task has none
    clock: Clock  # clock of the control loop
    hits: str = SIMULATED  # source of hits: an input device, or `simulated` for the geometry of the measured poses
    missed: float = 0.0  # share of simulated hits that are dropped
    edges: bool = False  # whether collision checks include sword and shield against the other arm's body

    def check(self, task: Task) -> None:
        """Check that a task fits the arms.

        Raises:
            OptionError: an arm or option is missing, or does not belong to the task.
        """
        if task.joints != JOINTS:
            raise OptionError(f"An ErgoJr cannot do the task of a {task.robot}; roll out ErgoReacher or ErgoShield.")
        if isinstance(task, ErgoShield) != (self.defender is not None):
            what = "needs a second arm: give --defender-port" if self.defender is None else "takes no --defender-port"
            raise OptionError(f"{type(task).__name__} {what}.")
        if not 0 <= self.missed <= 1 or (self.missed and (self.hits != SIMULATED or self.defender is None)):
            raise OptionError(
                f"--missed is {self.missed}; it must be in 0 … 1, and needs ErgoShield with --hits simulated."
            )
        if self.edges and self.defender is None:
            raise OptionError(
                "--apart all needs the two arms of ErgoShield: give --defender-port, or leave --apart out."
            )

    @contextmanager
    def open(self, task: Task, tally: RolloutTally) -> Iterator[tuple[Task, RobotStepper]]:
        """Take over the arms; yield the task with its source of hits, and the stepper that moves the arms.

        Raises:
            ArmError: an arm failed; the torque of all arms is off.
            OptionError: the input device cannot be read.
        """
        self.check(task)
        rest = np.zeros(len(JOINTS))
        with ExitStack() as stack:
            noticed = self._add_hit_source(task, stack)
            arms = [stack.enter_context(GuardedArm(self.attacker, self.clock))]
            if self.defender:
                arms.append(stack.enter_context(GuardedArm(self.defender, self.clock)))
                arms[0].share_guard(arms[1])
            motions = [arm.take(rest) for arm in arms]
            touching, approach = self.attacker.planner, self._make_single_approach(motions[0])
            if self.defender:
                touching = make_two_arm_planner(self.edges)
                seeking = TwoArmPlanner(self.defender.planner, (make_two_arm_planner(self.edges, CLEARANCE), touching))
                approach = Approach(motions[0], motions[1], seeking, touching)
            stepper = RobotStepper(
                motions[0],
                motions[1] if self.defender else None,
                task.simulator(),
                touching,
                approach,
                LOOKAHEAD * (self.attacker.driver.speed or NO_LOAD_SPEED),
                tally,
            )
            yield noticed, stepper

    def _make_single_approach(self, motion: ArmMotion) -> Callable[[np.ndarray], None]:
        """Return a function that brings a single arm to a pose [rad], shape (n,), with sag compensation."""
        planner = self.attacker.planner

        def approach(pose: np.ndarray) -> None:
            motion.approach(pose - planner.sag(pose))

        return approach

    def _add_hit_source(self, task: Task, stack: ExitStack) -> Task:
        """Return the task with its source of hits."""
        if not isinstance(task, ErgoShield):
            return task
        touched: Callable[[Stepper], np.ndarray] = detect_touches
        if self.hits != SIMULATED:
            touched = stack.enter_context(Keyboard(self.hits))
        return replace(task, touched=touched, missed=self.missed)


def make_path_planner() -> PathPlanner:
    """Return the path planner of a single arm with a pen holder."""
    return PathPlanner(find_robot(ARM))
