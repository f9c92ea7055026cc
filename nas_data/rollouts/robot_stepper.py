"""One arm, or two, in place of a batch of simulations: what is read is the state, what is commanded moves servos."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from nas_data.errors import OptionError
from nas_data.recorders.ergojr_motion import LEAD, Episode, Motion
from nas_data.recorders.ergojr_ways import Ways
from nas_data.simulators.base import Simulator
from nas_data.xl320.arm import Reading

HOT = 55.0  # [°C] of a servo at which the arms rest between two bouts; it would shut down at 65
AHEAD = 0.1  # [s] for which it is looked ahead whether a command leads into a touch


@dataclass
class Bout(Episode):
    """What was read and sent from one reset to the next.

    Attributes:
        opponents: States of the defender before the first command and after each, T + 1 of shape (m,); m may be 0.
    """

    opponents: list[np.ndarray] = field(default_factory=list)


class RobotStepper:
    """An arm, and a defender where the task has one, behind the interface of a batch of one simulation.

    A reset is a slow way to the first pose. A command that would bring the arm into touch with itself or the floor
    within a tenth of a second is not sent: the arm goes back to where it was safe. Sites are where the model has them
    in the measured pose.

    Attributes:
        joints: Names of the commanded joints.
        size: 1.
        held_back: Commands that were not sent.
        late: Readings after a command that came late.
        missed: Those of them whose moment was lost.
        steps: Commands so far.
    """

    def __init__(
        self,
        attacker: Motion,
        defender: Motion | None,
        model: Simulator,
        ways: Ways,
        reach: float,
        ended: Callable[[Bout], None] = lambda _: None,
    ) -> None:
        """Take arms over.

        Args:
            attacker: The arm that is commanded.
            defender: The other one.
            model: The task's model, which tells where sites are.
            ways: What the arm touches.
            reach: How far a joint may get in the time that is looked ahead [rad].
            ended: Told what was read and sent, at each reset and at the end.
        """
        self.joints, self.size = model.joints, 1
        self.held_back = self.late = self.missed = self.steps = 0
        self._attacker, self._defender, self._ways, self._reach = attacker, defender, ways, reach
        self._body, self._ended = model.stepper(1), ended
        self._width = model.object_feature.width
        self._bout, self._due = Bout(), 0.0
        self._state, self._opponent = np.zeros(2 * len(self.joints)), np.zeros(self._width)
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
        self.end()
        n = len(self.joints)
        self._guidance = states[0, 2 * n : 3 * n].copy()
        _bring(self._attacker, states[0, :n])
        if self._defender:
            _bring(self._defender, self._guidance)
        self._bout, self._due = Bout(), self._attacker.clock.now() + LEAD
        self._read()
        self._safe = self._state[:n]

    def guide(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the defender from now on; see `Stepper.guide`."""
        self._guidance = targets[0].copy()

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Send commands (1, n), wait for the end of the control period, and read the arms."""
        self._attacker.record_command(self._bout, self._careful(commands[0]))
        if self._defender:
            self._defender.send(self._guidance)
        self._due += self._attacker.period
        self._read()
        self.steps += 1
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

    def end(self) -> None:
        """Hand over what was read and sent since the last reset."""
        bout, self._bout = self._bout, Bout()
        if bout.commands:
            self.late += int(bout.late(self._attacker.period)[1:].sum())
            self.missed += int(bout.missed(self._attacker.period)[1:].sum())
            self._ended(bout)

    def _read(self) -> None:
        self._state = _state(self._attacker.record_reading(self._bout, self._due))
        if self._defender:
            self._opponent = _state(self._defender.sense())
        self._bout.opponents.append(self._opponent)

    def _careful(self, command: np.ndarray) -> np.ndarray:
        """Return a command [rad], shape (n,), or the last pose that was safe where it would lead into a touch."""
        n = len(self.joints)
        here = self._state[:n]
        led = here + np.clip(command - here, -self._reach, self._reach)
        coasting = here + self._state[n:] * AHEAD
        if any(self._ways.leads_into_touch(here, soon) for soon in (led, coasting)):
            self.held_back += 1
            return self._safe
        self._safe = here
        return command


def _bring(motion: Motion, pose: np.ndarray) -> None:
    """Go slowly to a pose [rad], shape (n,), and rest there where a servo is hot."""
    motion.approach(pose)
    if motion.vitals.temperature.max() >= HOT:
        motion.cool(pose, HOT)


def _state(reading: Reading) -> np.ndarray:
    return np.concatenate([reading.positions, reading.velocities])
