"""One arm, or two, in place of a batch of simulations: what is read is the state, what is commanded moves servos."""

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

HOT = 55.0  # [°C] of a servo at which the arms rest between two bouts; it would shut down at 65
AHEAD = 0.1  # [s] for which it is looked ahead whether a command leads into a touch


@dataclass
class Bout(ArmEpisode):
    """What was read and sent from one reset to the next.

    Attributes:
        opponents: States of the defender before the first command and after each, T + 1 of shape (m,); m may be 0.
    """

    opponents: list[np.ndarray] = field(default_factory=list)


@dataclass
class RolloutTally(RecordingStats):
    """Counts over all sittings of rollouts.

    Attributes:
        steps: Commands.
        late: Readings after a command that came late; those that were missed are among them.
        held_back: Commands that would have led into a touch, and were not sent.
        unheard: Times that a servo went unheard, in spite of the bus's own attempts, and was asked again.
    """

    steps: int = 0
    late: int = 0
    held_back: int = 0
    unheard: int = 0


class RobotStepper:
    """An arm, and a defender where the task has one, behind the interface of a batch of one simulation.

    A reset is a slow way to the first pose. A command that would bring the arm into touch with itself, the floor or
    the defender within a tenth of a second is not sent: the arm goes back to where it was last free of touches. The
    defender waits where it was safe while its own way would lead into the attacker. What leads out of a touch is sent.
    Sites are where the model has them in the measured pose.

    A servo that goes unheard is asked again while the arms stand still; the reading is flagged as late and missed, and
    the schedule goes on with the next moment that is not over. Only what lasts is an error.

    Attributes:
        joints: Names of the commanded joints.
        size: 1.
        tally: What happened so far.
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
        """Take arms over.

        Args:
            attacker: The arm that is commanded.
            defender: The other one.
            model: The task's model, which tells where sites are.
            planner: What touches in poses of the arm [rad], shape (n,), or of both, the attacker's first, shape (2n,).
            approach: Brings the arms slowly into such a pose [rad].
            reach: How far a joint may get in the time that is looked ahead [rad].
            tally: What happened so far; nothing where None.
        """
        self.joints, self.size, self.tally = model.joints, 1, tally or RolloutTally()
        self._attacker, self._defender, self._planner, self._reach = attacker, defender, planner, reach
        self._arms = (attacker, defender) if defender else (attacker,)
        self._body, self._approach, self._retries = model.stepper(1), approach, 0
        self._retry = Retry(TRIES, self._stand_still)
        for arm in self._arms:
            arm.retry = self._retry
        self._bouts, self._bout, self._due = list[Bout](), Bout(), 0.0
        self._state, self._opponent = np.zeros(2 * len(self.joints)), np.zeros(model.object_feature.width)
        self._guidance: np.ndarray = np.zeros(len(self.joints))
        self._safe: np.ndarray = self._guidance

    @property
    def states(self) -> np.ndarray:
        """Measured positions [rad] then velocities [rad/s], shape (1, 2n)."""
        return self._state[None]

    @property
    def objects(self) -> np.ndarray:
        """The same of the defender, shape (1, m)."""
        return self._opponent[None]

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Bring the arms slowly into their first poses, one after the other; see `Stepper.reset`."""
        self._end_bout()
        n = len(self.joints)
        self._guidance = states[0, 2 * n : 3 * n].copy()
        self._bring(np.concatenate([states[0, :n], self._guidance]) if self._defender else states[0, :n])
        self._bout, self._due = Bout(), self._attacker.clock.now() + LEAD
        self._read(self._retry.failures)
        here, _ = self._halves()
        self._safe = here - self._planner.sag(here)

    def guide(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the defender from now on; see `Stepper.guide`."""
        self._guidance = targets[0].copy()

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Send commands (1, n), wait for the end of the control period, and read the arms."""
        n, unheard = len(self.joints), self._retry.failures
        sent = self._avoid_contact(np.concatenate([commands[0], self._guidance]))
        self._attacker.record_command(self._bout, sent[:n])
        if self._defender:
            self._defender.send(sent[n:])
        self._due += self._attacker.period
        self._read(unheard)
        over = (self._attacker.clock.now() - self._due) // self._attacker.period
        self._due += max(0.0, over) * self._attacker.period  # moments that are over are not made up for in a hurry
        self.tally.steps += 1
        return self.states

    def set_states(self, states: np.ndarray) -> None:
        """Refuse: nobody can put a real arm into a state in motion.

        Raises:
            OptionError: always.
        """
        raise OptionError("A real arm cannot be put into a state; judge a policy on it without a learned model.")

    def site_positions(self, name: str) -> np.ndarray:
        """Return where the model has a site in the measured pose [m], shape (1, 3)."""
        self._body.reset(np.concatenate([self._state, self._opponent])[None])
        return self._body.site_positions(name)

    def take_bouts(self) -> list[Bout]:
        """Return what was read and sent since the last call, one bout from reset to reset; the present one is over."""
        self._end_bout()
        bouts, self._bouts = self._bouts, []
        retries = sum(motion.arm.retries for motion in self._arms)
        self.tally.retries, self._retries = self.tally.retries + retries - self._retries, retries
        self.tally.unheard, self._retry.failures = self.tally.unheard + self._retry.failures, 0
        return bouts

    def extend_deadline(self, seconds: float) -> None:
        """Tell the guards until when the next word comes [s from now]; raises as `ArmMotion.extend_deadline` does."""
        self._attacker.extend_deadline(seconds)

    def _end_bout(self) -> None:
        """Put what was read and sent since the last reset to the bouts."""
        bout, self._bout = self._bout, Bout()
        if bout.commands:
            self.tally.late += int(bout.late(self._attacker.period)[1:].sum())
            self.tally.missed += int(bout.missed(self._attacker.period)[1:].sum())
            self._bouts.append(bout)

    def _read(self, unheard: int) -> None:
        """Read the arms; flag that where the line has failed more often by then than a number says."""
        self._state = _state(self._attacker.record_reading(self._bout, self._due))
        if self._defender:
            self._opponent = _state(self._defender.sense())
        self._bout.opponents.append(self._opponent)
        if self._retry.failures > unheard:
            self._bout.unheard.add(len(self._bout.readings) - 1)

    def _bring(self, pose: np.ndarray) -> None:
        """Go slowly to a pose [rad], shape (n,) or (2n,), and rest there where a servo is hot."""
        self._approach(pose)
        held = pose - self._planner.sag(pose)
        for motion, command in zip(self._arms, np.split(held, len(self._arms)), strict=True):
            if motion.vitals.temperature.max() >= HOT:
                self.tally.pauses += 1
                motion.cool(command, HOT)

    def _stand_still(self) -> None:
        """Send the arms back to where they were safe: a command was looked after for a tenth of a second only."""
        if self._bout.commands:
            for motion, pose in zip(self._arms, np.split(self._safe, len(self._arms)), strict=True):
                motion.command(pose)

    def _avoid_contact(self, goal: np.ndarray) -> np.ndarray:
        """Return what may be sent: the goal, or for an arm that it would lead into a touch, what keeps it safe.

        The attacker gives way first, and then, where this is not enough, the defender, and then both.

        Args:
            goal: Of the attacker, and of the defender where there is one [rad], shape (n,) or (2n,).
        """
        n = len(self.joints)
        here, velocities = self._halves()
        attacker, defender = slice(0, n), slice(n, len(goal))
        soon = here + velocities * AHEAD
        if self._is_safe(goal, soon):
            return self._sent(goal, slice(0, len(goal)))
        self.tally.held_back += 1
        if self._is_safe(waiting := np.concatenate([self._safe[attacker], goal[defender]])):
            return self._sent(waiting, defender)
        if self._defender and self._is_safe(waiting := np.concatenate([goal[attacker], self._safe[defender]]), soon):
            return self._sent(waiting, attacker)
        return self._safe

    def _sent(self, command: np.ndarray, moving: slice) -> np.ndarray:
        """Return a command, and remember where the arms that it moves are free: there they may be sent back to."""
        here, _ = self._halves()
        if not self._planner.touches(here):
            self._safe = self._safe.copy()
            self._safe[moving] = (here - self._planner.sag(here))[moving]
        return command

    def _is_safe(self, goal: np.ndarray, *others: np.ndarray) -> bool:
        """Return whether a command [rad], shape (n,) or (2n,), leads into no touch, or out of the one there is."""
        here, _ = self._halves()
        led = self._led(goal + self._planner.sag(here))
        leaves = all(self._planner.leaves_contact(here, pose) for pose in ((here + led) / 2, led))
        return leaves or not self._touches_soon(led, *others)

    def _touches_soon(self, led: np.ndarray, *others: np.ndarray) -> bool:
        """Return whether poses [rad], shape (n,) or (2n,), and what is half-way to the first, bring a new touch."""
        here, _ = self._halves()
        poses = ((here + led) / 2, led, *others)  # a thin sword could be through at the end of the way
        return any(self._planner.enters_contact(here, pose) for pose in poses)

    def _led(self, goal: np.ndarray) -> np.ndarray:
        """Return where an arm gets on its way to a pose [rad], shape (n,) or (2n,), in the time looked ahead."""
        here, _ = self._halves()
        return np.asarray(here + np.clip(goal - here, -self._reach, self._reach))

    def _halves(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [rad] and velocities [rad/s] of the attacker, then of the defender, (n,) or (2n,) each."""
        own, others = np.split(self._state, 2), np.split(self._opponent, 2)
        return np.concatenate([own[0], others[0]]), np.concatenate([own[1], others[1]])


def _state(reading: Reading) -> np.ndarray:
    return np.concatenate([reading.positions, reading.velocities])
