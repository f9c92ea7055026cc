"""Stepper for real arms: readings are the state, and commands move servos."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from nas_data.errors import OptionError
from nas_data.hardware.xl320.arm import Reading
from nas_data.recorders.arm_motion import LEAD, ArmEpisode, ArmMotion
from nas_data.recorders.arm_tally import RecordingStats
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.retry import TRIES, Retry
from nas_data.simulators.base import Simulator

HOT = 55.0  # [°C] at which the arms pause between two episodes; a servo shuts down at 65 °C
LOOKAHEAD = 0.1  # [s] lookahead of the collision check


@dataclass
class ArmAttempt(ArmEpisode):
    """Readings and commands from one reset to the next."""

    # defender states before the first command and after each, T + 1 of shape (m,); m may be 0
    opponents: list[np.ndarray] = field(default_factory=list)


@dataclass
class RolloutTally(RecordingStats):
    """Counts over all sessions of rollouts."""

    steps: int = 0  # commands
    late: int = 0  # late readings after a command, including the missed ones
    held_back: int = 0  # commands that were replaced because they would have caused a collision
    unheard: int = 0  # transactions that were repeated after the attempts of the bus had failed


class RobotStepper:
    """One or two arms behind the interface of a simulation batch of size 1.

    A reset moves the arms slowly to the first pose. A command is not sent if it would cause a collision with the arm
    itself, the floor or the other arm within 0.1 s. The arm then returns to its last collision-free pose, and the
    defender waits in its own. Commands that open a contact are sent. Site positions are computed by the model in the
    measured pose.

    After a transient bus error the arms stand still and the reading is repeated. It is flagged as late and missed, and
    the schedule continues with the next full period. Only persistent errors are raised.
    """

    def __init__(
        self,
        attacker: ArmMotion,
        defender: ArmMotion | None,
        model: Simulator,
        planner: PathPlanner,
        approach: Callable[[np.ndarray], None],
        reach: float,
        tally: RolloutTally | None = None,
    ) -> None:
        """Take over the arms.

        Args:
            attacker: The arm that the policy commands.
            defender: The second arm; None if the task has none.
            model: Simulator of the task, for the sites.
            planner: Collision checks in poses [rad] of the arm, shape (n,), or of both, shape (2n,).
            approach: Brings the arms slowly to such a pose [rad].
            reach: Largest joint travel within the lookahead [rad].
            tally: Statistics to continue; new ones if None.
        """
        self.joints, self.size, self.tally = model.joints, 1, tally or RolloutTally()
        self._attacker, self._defender, self._planner, self._reach = attacker, defender, planner, reach
        self._arms = (attacker, defender) if defender else (attacker,)
        self._body, self._approach, self._retries = model.stepper(1), approach, 0
        self._retry = Retry(TRIES, self._stand_still)
        for arm in self._arms:
            arm.retry = self._retry
        self._attempts, self._attempt, self._due = list[ArmAttempt](), ArmAttempt(), 0.0
        self._state, self._opponent = np.zeros(2 * len(self.joints)), np.zeros(model.object_feature.width)
        self._guidance: np.ndarray = np.zeros(len(self.joints))
        self._safe: np.ndarray = self._guidance

    @property
    def states(self) -> np.ndarray:
        """Measured positions [rad] then velocities [rad/s], shape (1, 2n)."""
        return self._state[None]

    @property
    def objects(self) -> np.ndarray:
        """Measured state of the defender, shape (1, m)."""
        return self._opponent[None]

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Move the arms slowly to their first poses; see `Stepper.reset`."""
        self._end_attempt()
        n = len(self.joints)
        self._guidance = states[0, 2 * n : 3 * n].copy()
        self._move_to(np.concatenate([states[0, :n], self._guidance]) if self._defender else states[0, :n])
        self._attempt, self._due = ArmAttempt(), self._attacker.clock.now() + LEAD
        self._read(self._retry.failures)
        here, _ = self._measured()
        self._safe = here - self._planner.sag(here)

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Set the defender's command for the next steps; see `Stepper.command_objects`."""
        self._guidance = targets[0].copy()

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Send commands [rad], shape (1, n), wait for the end of the control period, and read the arms."""
        n, failures = len(self.joints), self._retry.failures
        sent = self._avoid_contact(np.concatenate([commands[0], self._guidance]))
        self._attacker.record_command(self._attempt, sent[:n])
        if self._defender:
            self._defender.send(sent[n:])
        self._due += self._attacker.period
        self._read(failures)
        over = (self._attacker.clock.now() - self._due) // self._attacker.period
        self._due += max(0.0, over) * self._attacker.period  # skip missed periods instead of catching up
        self.tally.steps += 1
        return self.states

    def set_states(self, states: np.ndarray) -> None:
        """Refuse: a real arm cannot be set to a moving state.

        Raises:
            OptionError: always.
        """
        raise OptionError("A real arm cannot be set to a state; evaluate the policy without a learned model.")

    def site_positions(self, name: str) -> np.ndarray:
        """Return the position of a site in the measured pose [m], shape (1, 3)."""
        self._body.reset(np.concatenate([self._state, self._opponent])[None])
        return self._body.site_positions(name)

    def pop_attempts(self) -> list[ArmAttempt]:
        """End the present attempt, and return all attempts since the last call."""
        self._end_attempt()
        attempts, self._attempts = self._attempts, []
        retries = sum(motion.arm.retries for motion in self._arms)
        self.tally.retries, self._retries = self.tally.retries + retries - self._retries, retries
        self.tally.unheard, self._retry.failures = self.tally.unheard + self._retry.failures, 0
        return attempts

    def extend_deadline(self, seconds: float) -> None:
        """Tell the watchdogs that the next message comes within a time [s]; raises like `ArmMotion.extend_deadline`."""
        self._attacker.extend_deadline(seconds)

    def _end_attempt(self) -> None:
        """Append the readings and commands since the last reset to the attempts."""
        attempt, self._attempt = self._attempt, ArmAttempt()
        if attempt.commands:
            self.tally.late += int(attempt.late(self._attacker.period)[1:].sum())
            self.tally.missed += int(attempt.missed(self._attacker.period)[1:].sum())
            self._attempts.append(attempt)

    def _read(self, failures: int) -> None:
        """Read the arms; flag the reading if there were more bus errors than `failures`."""
        self._state = _stack_state(self._attacker.record_reading(self._attempt, self._due))
        if self._defender:
            self._opponent = _stack_state(self._defender.sense())
        self._attempt.opponents.append(self._opponent)
        if self._retry.failures > failures:
            self._attempt.after_bus_error.add(len(self._attempt.readings) - 1)

    def _move_to(self, pose: np.ndarray) -> None:
        """Move slowly to a pose [rad], shape (n,) or (2n,), and cool there if a servo is hot."""
        self._approach(pose)
        held = pose - self._planner.sag(pose)
        for motion, command in zip(self._arms, np.split(held, len(self._arms)), strict=True):
            if motion.vitals.temperature.max() >= HOT:
                self.tally.pauses += 1
                motion.cool(command, HOT)

    def _stand_still(self) -> None:
        """Send the arms to their last safe poses: a command was checked for the next 0.1 s only."""
        if self._attempt.commands:
            for motion, pose in zip(self._arms, np.split(self._safe, len(self._arms)), strict=True):
                motion.command(pose)

    def _avoid_contact(self, goal: np.ndarray) -> np.ndarray:
        """Return the goal [rad], shape (n,) or (2n,), with the safe pose for arms that would collide.

        The attacker is stopped first, then the defender instead, then both.
        """
        n = len(self.joints)
        here, velocities = self._measured()
        attacker, defender = slice(0, n), slice(n, len(goal))
        soon = here + velocities * LOOKAHEAD
        if self._is_safe(goal, soon):
            return self._accept(goal, slice(0, len(goal)))
        self.tally.held_back += 1
        if self._is_safe(waiting := np.concatenate([self._safe[attacker], goal[defender]])):
            return self._accept(waiting, defender)
        if self._defender and self._is_safe(waiting := np.concatenate([goal[attacker], self._safe[defender]]), soon):
            return self._accept(waiting, attacker)
        return self._safe

    def _accept(self, command: np.ndarray, moving: slice) -> np.ndarray:
        """Return a command; store the present pose of the moving arms as safe if it is collision-free."""
        here, _ = self._measured()
        if not self._planner.touches(here):
            self._safe = self._safe.copy()
            self._safe[moving] = (here - self._planner.sag(here))[moving]
        return command

    def _is_safe(self, goal: np.ndarray, *others: np.ndarray) -> bool:
        """Return whether a command [rad], shape (n,) or (2n,), makes no contact, or opens the present one."""
        here, _ = self._measured()
        reached = self._predict(goal + self._planner.sag(here))
        leaves = all(self._planner.leaves_contact(here, pose) for pose in ((here + reached) / 2, reached))
        return leaves or not self._is_about_to_touch(reached, *others)

    def _is_about_to_touch(self, reached: np.ndarray, *others: np.ndarray) -> bool:
        """Return whether poses [rad], shape (n,) or (2n,), or the midpoint to the first, make a new contact."""
        here, _ = self._measured()
        poses = (
            (here + reached) / 2,
            reached,
            *others,
        )  # at the end of the path a thin sword could have passed through
        return any(self._planner.enters_contact(here, pose) for pose in poses)

    def _predict(self, goal: np.ndarray) -> np.ndarray:
        """Return the pose reached within the lookahead on the way to a goal [rad], shape (n,) or (2n,)."""
        here, _ = self._measured()
        return np.asarray(here + np.clip(goal - here, -self._reach, self._reach))

    def _measured(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [rad] and velocities [rad/s], attacker first, shape (n,) or (2n,) each."""
        own, others = np.split(self._state, 2), np.split(self._opponent, 2)
        return np.concatenate([own[0], others[0]]), np.concatenate([own[1], others[1]])


def _stack_state(reading: Reading) -> np.ndarray:
    return np.concatenate([reading.positions, reading.velocities])
