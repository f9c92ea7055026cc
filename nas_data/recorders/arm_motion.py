"""One arm in motion: slow ways to a pose, and episodes played and read on schedule."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from nas_data.dataset.timing import late_readings
from nas_data.hardware.arms.base import Arm, Health, Reading
from nas_data.recorders.arm_ways import Ways
from nas_data.recorders.schedule import Clock
from nas_data.recorders.tolerance import Tolerance

APPROACH = 0.6  # [rad/s] of a slow way
SETTLE = 0.5  # [s] that a pose is held before what follows
LEAD = 0.02  # [s] from the decision to begin to the first reading
COOLING = 5.0  # [s] between two looks at an arm that cools
COOL = 5.0  # [°C] below the limit at which it goes on
LOOK = 10  # control steps between two looks at the supply and warmth of a servo, one after the other


@dataclass
class Vitals:
    """What was last heard of each servo's supply and warmth.

    Attributes:
        voltage: [V], shape (n,).
        temperature: [°C], shape (n,).
    """

    voltage: np.ndarray
    temperature: np.ndarray


@dataclass
class ArmEpisode:
    """What was read and sent in an episode of T steps.

    Attributes:
        due: When each reading should have been made [s].
        readings: Before the first command and after each, T + 1.
        commands: As they were sent [rad], T of shape (n,).
        voltages: [V], T of shape (n,).
        temperatures: [°C], T of shape (n,).
        unheard: Places of readings before which the line failed and was asked again.
    """

    due: list[float] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)
    commands: list[np.ndarray] = field(default_factory=list)
    voltages: list[np.ndarray] = field(default_factory=list)
    temperatures: list[np.ndarray] = field(default_factory=list)
    unheard: set[int] = field(default_factory=set)

    def held(self) -> np.ndarray:
        """Return the commands that the servos held in each step [rad], shape (T, n).

        Where they are read back, the reading after a command tells them: one that was lost on the line did not count.
        """
        after = [reading.goals for reading in self.readings[1:]]
        pairs = zip(self.commands, after, strict=True)
        return np.array([sent if goals is None else goals for sent, goals in pairs])

    def delays(self) -> np.ndarray:
        """Return how long after its time each reading was made [s], shape (T + 1,)."""
        return np.array([reading.time for reading in self.readings]) - np.array(self.due)

    def late(self, period: float) -> np.ndarray:
        """Return which readings came late, shape (T + 1,); those that were asked for again did."""
        return late_readings(self.delays(), period) | self._asked_again()

    def missed(self, period: float) -> np.ndarray:
        """Return which readings came so late that their moment is lost, shape (T + 1,)."""
        return (self.delays() > period) | self._asked_again()

    def repeated(self) -> np.ndarray:
        """Return which readings are those before byte for byte although the arm moves, shape (T + 1,)."""
        again = [a.raw == b.raw and bool(b.velocities.any()) for a, b in pairwise(self.readings)]
        return np.array([False, *again])

    def _asked_again(self) -> np.ndarray:
        return np.isin(np.arange(len(self.readings)), list(self.unheard))


class ArmMotion:
    """Moves an arm whose torque is on.

    Attributes:
        arm: The arm.
        clock: By which it is moved.
        period: Control period [s].
        vitals: What was last heard of supply and warmth.
        tolerance: How errors of the line that may pass are met; they are raised at once where nobody sets another.
    """

    def __init__(
        self,
        arm: Arm,
        clock: Clock,
        period: float,
        largest_step: float,
        ways: Ways,
        alive: Callable[[float], None] = lambda _: None,
    ) -> None:
        """Take an arm over.

        Args:
            arm: The arm.
            clock: By which it is moved.
            period: Control period [s].
            largest_step: By how much a command may differ from the one before [rad; at a slide times what stands for
                a radian there].
            ways: How it gets to a pose without touching anything.
            alive: Told at every reading until when the next one comes [s from now].
        """
        self.arm, self.clock, self.period = arm, clock, period
        self._largest_step, self._ways, self._alive = largest_step * ways.radians, ways, alive
        self.tolerance = Tolerance()
        self._sent = arm.read().positions
        self._steps = 0
        first = [arm.look_after(place) for place in range(len(arm.names))]
        self.vitals = Vitals(
            np.array([health.voltage for health in first]), np.array([float(health.temperature) for health in first])
        )

    def approach(self, pose: np.ndarray) -> None:
        """Go to a pose [rad], shape (n,), slowly and without touching anything, and hold it for a moment.

        Raises:
            WayBlocked: there is no free way.
            ArmError: something is wrong with the arm.
        """
        begin = self.tolerance.ask(self.arm.read).positions
        corners = np.stack([begin, *self._ways.find(begin, pose)])
        slow = [slowly(a, b, self.period, self._ways.radians) for a, b in pairwise(corners)]
        self.play(np.concatenate([*slow, np.repeat(pose[None], round(SETTLE / self.period), axis=0)]))

    def hold(self, pose: np.ndarray, seconds: float) -> None:
        """Stay in a pose [rad], shape (n,), for a time [s]; raises as `approach` does."""
        self.play(np.repeat(pose[None], max(1, round(seconds / self.period)), axis=0))

    def cool(self, pose: np.ndarray, hot: float) -> None:
        """Rest in a pose [rad], shape (n,), until the warmest servo is well below a temperature [°C]."""
        while self.vitals.temperature.max() > hot - COOL:
            self.hold(pose, COOLING)

    def play(self, commands: np.ndarray) -> ArmEpisode:
        """Send commands [rad], shape (T, n), one a period, and read the arm before each and after the last.

        Raises:
            ArmError: something is wrong with the arm.
        """
        episode, start = ArmEpisode(), self.clock.now() + LEAD
        for number, wanted in enumerate(commands):
            self.record_reading(episode, start + number * self.period)
            self.record_command(episode, wanted)
        self.record_reading(episode, start + len(commands) * self.period)
        return episode

    def promise(self, seconds: float) -> None:
        """Tell the guard until when the next word comes [s from now].

        Raises:
            GuardLost: the guard is gone.
        """
        self._alive(seconds)

    def sense(self) -> Reading:
        """Read the arm.

        Raises:
            ArmError: something is wrong with the arm.
        """
        return self.tolerance.ask(self._sense)

    def send(self, wanted: np.ndarray) -> np.ndarray:
        """Send a command [rad], shape (n,), no farther from the last than is allowed; return it as it was sent.

        Raises:
            ArmError: something is wrong with the arm.
        """
        sent = self.command(wanted)
        self._look_after()
        return sent

    def command(self, wanted: np.ndarray) -> np.ndarray:
        """Send a command as `send` does, and look after nothing.

        Raises:
            AdapterLost: the port is gone.
        """
        self._sent = self._sent + np.clip(wanted - self._sent, -self._largest_step, self._largest_step)
        return self.arm.command(self._sent)

    def record_command(self, episode: ArmEpisode, wanted: np.ndarray) -> None:
        """Send a command [rad], shape (n,), and add it and the vitals to an episode; raises as `send` does."""
        episode.commands.append(self.send(wanted))
        episode.voltages.append(self.vitals.voltage.copy())
        episode.temperatures.append(self.vitals.temperature.copy())

    def record_reading(self, episode: ArmEpisode, due: float) -> Reading:
        """Read the arm at a time [s] and add it to an episode; raises as `sense` does."""
        self.clock.wait_until(due)
        reading = self.sense()
        episode.due.append(due)
        episode.readings.append(reading)
        return reading

    def _sense(self) -> Reading:
        self._alive(self.period)
        reading = self.arm.read()
        self.arm.refuse_alerts(reading)
        return reading

    def _health(self, place: int) -> Health:
        self._alive(self.period)
        return self.arm.look_after(place)

    def _look_after(self) -> None:
        """Read supply and warmth of the next servo, now and then."""
        self._steps += 1
        turn, rest = divmod(self._steps, LOOK)
        if rest:
            return
        place = turn % len(self.arm.names)
        health = self.tolerance.ask(lambda: self._health(place))
        self.vitals.voltage[place], self.vitals.temperature[place] = health.voltage, health.temperature


def slowly(begin: np.ndarray, end: np.ndarray, period: float, radians: np.ndarray | float = 1.0) -> np.ndarray:
    """Return the commands of a straight slow way between poses [rad; m], one a control period [s], shape (T, n).

    Args:
        begin: First pose, shape (n,).
        end: Last pose, shape (n,).
        period: Control period [s].
        radians: What stands for a radian at each joint, shape (n,).
    """
    steps = max(1, int(np.ceil((np.abs(end - begin) / radians).max() / APPROACH / period)))
    return np.asarray(begin + np.arange(1, steps + 1)[:, None] / steps * (end - begin))
