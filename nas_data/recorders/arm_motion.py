"""Motion of one arm: slow paths to a pose, and episodes commanded and read at the control rate."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from nas_data.dataset.timing import find_late_readings
from nas_data.hardware.arms.base import Arm, Health, Reading
from nas_data.recorders.path_planner import PathPlanner
from nas_data.recorders.retry import Retry
from nas_data.recorders.schedule import Clock

APPROACH = 0.6  # [rad/s] highest joint speed on a slow path
FOLLOWED = 0.8  # share of a speed limit at which the servos keep up with their commands
SEEKING = 10.0  # [s] allowed for planning a path
SETTLE = 0.5  # [s] for which a pose is held after an approach
LEAD = 0.02  # [s] between the start of an episode and its first reading
COOLING = 5.0  # [s] between two temperature checks while the arm cools
COOL = 5.0  # [°C] below the limit at which the recording continues
HEALTH_CHECK_STEPS = 10  # control steps between two checks of voltage and temperature; servos take turns


@dataclass
class ServoHealth:
    """Last known supply voltage and temperature of each servo.

    Attributes:
        voltage: [V], shape (n,).
        temperature: [°C], shape (n,).
    """

    voltage: np.ndarray
    temperature: np.ndarray


@dataclass
class ArmEpisode:
    """Readings and commands of an episode of T steps.

    Attributes:
        due: Scheduled time of each reading [s].
        readings: One before the first command and one after each, T + 1.
        commands: Commands as sent [rad], T of shape (n,).
        voltages: [V], T of shape (n,).
        temperatures: [°C], T of shape (n,).
        after_bus_error: Indices of readings that were repeated after a bus error.
    """

    due: list[float] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)
    commands: list[np.ndarray] = field(default_factory=list)
    voltages: list[np.ndarray] = field(default_factory=list)
    temperatures: list[np.ndarray] = field(default_factory=list)
    after_bus_error: set[int] = field(default_factory=set)

    def active_commands(self) -> np.ndarray:
        """Return the commands that were active in each step [rad], shape (T, n).

        If the servos report their goals, the reading after a command decides: a lost packet changes no goal.
        """
        after = [reading.goals for reading in self.readings[1:]]
        pairs = zip(self.commands, after, strict=True)
        return np.array([sent if goals is None else goals for sent, goals in pairs])

    def delays(self) -> np.ndarray:
        """Return the delay of each reading [s], shape (T + 1,)."""
        return np.array([reading.time for reading in self.readings]) - np.array(self.due)

    def late(self, period: float) -> np.ndarray:
        """Return a mask of the late readings, shape (T + 1,); repeated readings count as late."""
        return find_late_readings(self.delays(), period) | self._find_repeated()

    def missed(self, period: float) -> np.ndarray:
        """Return a mask of the readings that were late by more than a control period, shape (T + 1,)."""
        return (self.delays() > period) | self._find_repeated()

    def repeated(self) -> np.ndarray:
        """Return a mask of the readings that equal the previous one bytewise while the arm moves, shape (T + 1,)."""
        again = [a.raw == b.raw and bool(b.velocities.any()) for a, b in pairwise(self.readings)]
        return np.array([False, *again])

    def _find_repeated(self) -> np.ndarray:
        return np.isin(np.arange(len(self.readings)), list(self.after_bus_error))


class ArmMotion:
    """Moves an arm whose torque is on.

    Attributes:
        arm: The arm.
        clock: Clock of the control loop.
        period: Control period [s].
        slow_speed: Joint speed on slow paths [rad/s], which the servos can follow.
        vitals: Last known voltages and temperatures.
        retry: Repeats transactions after transient bus errors; by default they are raised at once.
    """

    def __init__(
        self,
        arm: Arm,
        clock: Clock,
        period: float,
        largest_step: float,
        planner: PathPlanner,
        extend_deadline: Callable[[float], None] = lambda _: None,
        speed: float = 0.0,
    ) -> None:
        """Take over an arm whose torque is on.

        Args:
            arm: The arm.
            clock: Clock of the control loop.
            period: Control period [s].
            largest_step: Largest difference between successive commands [rad]; slides scale it by `planner.radians`.
            planner: Finds collision-free paths.
            extend_deadline: Called at every reading with the time until the next one [s].
            speed: Speed limit of the servos [rad/s]; 0 for none.
        """
        self.slow_speed = min(APPROACH, FOLLOWED * min(largest_step / period, speed or np.inf))
        self.arm, self.clock, self.period = arm, clock, period
        self._largest_step, self._planner, self._extend_deadline = (
            largest_step * planner.radians,
            planner,
            extend_deadline,
        )
        self.retry = Retry()
        self._sent = arm.read().positions
        self._steps = 0
        first = [arm.check_servo(index) for index in range(len(arm.names))]
        self.vitals = ServoHealth(
            np.array([health.voltage for health in first]), np.array([float(health.temperature) for health in first])
        )

    def approach(self, pose: np.ndarray) -> np.ndarray:
        """Move slowly to a pose [rad; m], shape (n,), on a collision-free path, and hold it for half a second.

        Returns:
            Positions at the end [rad; m], shape (n,).

        Raises:
            PathBlocked: no path is free.
            ArmError: the arm failed.
        """
        begin = self.retry.call(self.arm.read).positions
        self._extend_deadline(SEEKING)
        corners = np.stack([begin, *self._planner.find(begin, pose)])
        step = self.slow_speed * self.period * self._planner.radians
        slow = [plan_slow_path(a, b, step) for a, b in pairwise(corners)]
        slow.append(np.repeat(pose[None], round(SETTLE / self.period), axis=0))
        return self.play(np.concatenate(slow)).readings[-1].positions

    def hold(self, pose: np.ndarray, seconds: float) -> None:
        """Hold a pose [rad], shape (n,), for a time [s]; raises like `play`."""
        self.play(np.repeat(pose[None], max(1, round(seconds / self.period)), axis=0))

    def cool(self, pose: np.ndarray, hot: float) -> None:
        """Hold a pose [rad], shape (n,), until all servos are 5 °C below a temperature [°C]."""
        while self.vitals.temperature.max() > hot - COOL:
            self.hold(pose, COOLING)

    def play(self, commands: np.ndarray) -> ArmEpisode:
        """Send one command per period, and read the arm before each and after the last.

        Args:
            commands: Commands [rad], shape (T, n).

        Raises:
            ArmError: the arm failed.
        """
        episode, start = ArmEpisode(), self.clock.now() + LEAD
        for number, wanted in enumerate(commands):
            self.record_reading(episode, start + number * self.period)
            self.record_command(episode, wanted)
        self.record_reading(episode, start + len(commands) * self.period)
        return episode

    def extend_deadline(self, seconds: float) -> None:
        """Tell the watchdog that the next message comes within a time [s].

        Raises:
            GuardLost: the watchdog process has ended.
        """
        self._extend_deadline(seconds)

    def sense(self) -> Reading:
        """Read the arm, and refuse servos in an error state.

        Raises:
            ArmError: the arm failed.
        """
        return self.retry.call(self._sense)

    def send(self, wanted: np.ndarray) -> np.ndarray:
        """Send a command, limited to the largest step, and check one servo now and then.

        Args:
            wanted: Command [rad], shape (n,).

        Returns:
            The command as sent [rad], shape (n,).

        Raises:
            ArmError: the arm failed.
        """
        sent = self.command(wanted)
        self._check_next_servo()
        return sent

    def command(self, wanted: np.ndarray) -> np.ndarray:
        """Send a command like `send`, without checking a servo.

        Raises:
            AdapterLost: the port is gone.
        """
        self._sent = limit_step(wanted, self._sent, self._largest_step)
        return self.arm.command(self._sent)

    def record_command(self, episode: ArmEpisode, wanted: np.ndarray) -> None:
        """Send a command [rad], shape (n,); append it and the vitals to an episode. Raises like `send`."""
        episode.commands.append(self.send(wanted))
        episode.voltages.append(self.vitals.voltage.copy())
        episode.temperatures.append(self.vitals.temperature.copy())

    def record_reading(self, episode: ArmEpisode, due: float) -> Reading:
        """Read the arm at a time [s] and append the reading to an episode. Raises like `sense`."""
        self.clock.wait_until(due)
        reading = self.sense()
        episode.due.append(due)
        episode.readings.append(reading)
        return reading

    def _sense(self) -> Reading:
        self._extend_deadline(self.period)
        reading = self.arm.read()
        self.arm.refuse_alerts(reading)
        return reading

    def _check_servo(self, index: int) -> Health:
        self._extend_deadline(self.period)
        return self.arm.check_servo(index)

    def _check_next_servo(self) -> None:
        """Read voltage and temperature of the next servo every `HEALTH_CHECK_STEPS` steps."""
        self._steps += 1
        turn, rest = divmod(self._steps, HEALTH_CHECK_STEPS)
        if rest:
            return
        index = turn % len(self.arm.names)
        health = self.retry.call(lambda: self._check_servo(index))
        self.vitals.voltage[index], self.vitals.temperature[index] = health.voltage, health.temperature


def limit_step(wanted: np.ndarray, last: np.ndarray, step: np.ndarray | float) -> np.ndarray:
    """Return the command [rad; m], shape (n,) or (E, n), that differs from the last one by at most a step."""
    return np.asarray(last + np.clip(wanted - last, -step, step))


def plan_slow_path(begin: np.ndarray, end: np.ndarray, step: np.ndarray | float) -> np.ndarray:
    """Return the commands of a slow straight line in joint space [rad; m], one per period, shape (T, n).

    Args:
        begin: First pose [rad; m], shape (n,).
        end: Last pose [rad; m], shape (n,).
        step: Largest travel in one period [rad; m], one for all or shape (n,).
    """
    steps = max(1, int(np.ceil((np.abs(end - begin) / step).max())))
    return np.asarray(begin + np.arange(1, steps + 1)[:, None] / steps * (end - begin))
