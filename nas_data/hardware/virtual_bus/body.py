"""Simulated body of an arm, driven by the servos' registers, with supply voltage, temperature and overload.

Stall currents are from the manuals; thermal resistance and supply resistance are plausible values, not measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nas_data.hardware.virtual_bus.kinds.base import Bounds, Reason, ServoDrive, ServoMeasurements, ServoSeries
from nas_data.hardware.virtual_bus.servo import VirtualServo
from nas_data.robots.base import Robot
from nas_data.simulators.base import Simulator
from nas_data.simulators.layout import find_actuator_index, find_joint_index

IDLE_CURRENT = 0.03  # [A] of a servo without load
SUPPLY_RESISTANCE = 0.15  # [Ω] of supply and wires
HEATING = 12.0  # [K/W] thermal resistance to the air
WARMING = 240.0  # [s] thermal time constant


@dataclass
class Electrics:
    """Voltages and temperatures of n servos."""

    kinds: Sequence[ServoSeries]  # series of each servo
    air: float = 25.0  # ambient temperature [°C]
    supply: np.ndarray | float = field(init=False)  # voltage of each servo without load [V], shape (n,), or one for all
    voltage: np.ndarray | float = field(init=False)  # voltage of each servo [V], shape (n,), or one for all
    temperature: np.ndarray = field(init=False)  # temperature of each servo [°C], shape (n,)

    def __post_init__(self) -> None:
        self.supply = self.voltage = np.array([kind.supply for kind in self.kinds])
        self.temperature = np.full(len(self.kinds), self.air)
        self._stall = np.array([kind.stall_current for kind in self.kinds])
        self._strained: np.ndarray = np.zeros(len(self.kinds))

    def advance(self, duty: np.ndarray, strain: np.ndarray, seconds: float) -> None:
        """Advance voltages, temperatures and stall times by some seconds.

        The duty is the signed share of the largest torque of each servo, the strain that above which it counts as
        stalled, shape (n,) each.
        """
        current = IDLE_CURRENT + self._stall * np.abs(duty)
        self.voltage = np.maximum(0.0, self.supply - SUPPLY_RESISTANCE * float(current.sum()))
        warm = self.air + HEATING * self.voltage * self._stall * np.square(duty)
        self.temperature += (warm - self.temperature) * min(1.0, seconds / WARMING)
        self._strained = np.where(np.abs(duty) >= strain, self._strained + seconds, 0.0)

    def volts(self, index: int) -> float:
        """Return the voltage at one servo [V]."""
        return float(np.broadcast_to(self.voltage, len(self.kinds))[index])

    def reasons(self, index: int, bounds: Bounds) -> Reason:
        """Return the reasons for which a servo must shut down."""
        found = Reason(0)
        if self._strained[index] > bounds.seconds:
            found |= Reason.OVERLOAD
        if self.temperature[index] > bounds.hottest:
            found |= Reason.OVERHEAT
        if not bounds.lowest <= self.volts(index) <= bounds.highest:
            found |= Reason.VOLTAGE
        return found


LONGEST = 2.0  # [s] most simulated time to catch up after the process was suspended


@dataclass(frozen=True)
class Encoders:
    """Conversion between joint positions and encoder counts."""

    signs: np.ndarray  # 1 if a joint turns with its servo, −1 otherwise, shape (n,)
    zeros: np.ndarray  # counts where the joints are at zero, shape (n,)
    ticks: np.ndarray  # angle of a count [rad], shape (n,)

    def raw(self, positions: np.ndarray) -> np.ndarray:
        """Return encoder counts for positions [rad], shape (n,)."""
        return np.rint(self.signs * positions / self.ticks + self.zeros).astype(int)

    def positions(self, raw: np.ndarray) -> np.ndarray:
        """Return positions [rad] for encoder counts, shape (n,)."""
        return np.asarray(self.signs * (raw - self.zeros) * self.ticks)


class SimulatedBody:
    """An arm in a simulator, initially at rest.

    Gains and torque limits of servos change the command to the simulator. Without torque the command follows the joint,
    so that only friction acts on it.
    """

    def __init__(self, simulator: Simulator, robot: Robot, servos: Sequence[VirtualServo], encoders: Encoders) -> None:
        """Mount servos in an arm.

        Args:
            simulator: Simulator of the arm; its period is the simulation step.
            robot: Model of the arm, for torque limits and gains of the servos.
            servos: One servo per joint, in joint order.
            encoders: Conversion between positions and counts.
        """
        self._stepper = simulator.stepper(1)
        self.servos, self.encoders = list(servos), encoders
        self.electrics = Electrics([servo.kind for servo in self.servos])
        self.time = self._renewed = 0.0  # [s] simulated
        self.renewal = 0.0  # [s] update period of the servos' readings; 0 for every step
        self._step_time = simulator.period
        self._gain, self._strength = read_gains_and_limits(robot, self.servos)
        self._duty = np.zeros(len(self.servos))
        self._goal: np.ndarray = self.positions.copy()
        self._pace: np.ndarray = np.zeros(len(self.servos))
        self._drives: list[ServoDrive] = []
        self.sense()

    @property
    def positions(self) -> np.ndarray:
        """Joint positions [rad], shape (n,)."""
        return np.asarray(self._stepper.states[0, : len(self.servos)])

    def set_state(self, state: np.ndarray) -> None:
        """Set the state of the arm: positions [rad] then velocities [rad/s], shape (2n,)."""
        self._stepper.reset(state[None])
        self._goal, self._pace = self.positions.copy(), np.zeros(len(self.servos))
        self.sense()

    def advance_to(self, time: float) -> None:
        """Simulate until a time [s] on the arm's clock, then update the servos' readings."""
        if time - self.time > LONGEST:
            self.time = time - LONGEST
        steps = int((time - self.time) / self._step_time + 1e-9)
        for _ in range(steps):
            self._step()
        self.time += steps * self._step_time
        if self.time - self._renewed >= max(self.renewal, self._step_time) - 1e-9:
            self._renewed = self.time
            self.sense()

    def sense(self) -> None:
        """Write measurements into the registers, and shut down servos outside their operating limits."""
        n = len(self.servos)
        states = self._stepper.states[0]
        raw = self.encoders.raw(states[:n])
        speeds = self.encoders.signs * states[n:]
        efforts = self.encoders.signs * self._duty
        for index, servo in enumerate(self.servos):
            measured = ServoMeasurements(
                position=int(raw[index]),
                speed=float(speeds[index]),
                effort=float(efforts[index]),
                voltage=self.electrics.volts(index),
                temperature=float(self.electrics.temperature[index]),
            )
            servo.kind.sense(servo, measured)
            reasons = self.electrics.reasons(index, servo.kind.bounds(servo))
            if reasons:
                servo.fail(reasons)

    def _step(self) -> None:
        """Advance by one step with the servos' present goals, gains and limits."""
        self._read_drives()
        positions, most = self.positions, self._most
        self._approach(positions)
        error = self._stiffness * (self._goal - positions)
        error = np.where(np.abs(error) <= self._stiffness * self._deadband, 0.0, error)
        reach = most * self._strength / self._gain
        limited = np.where((most < 1) | (self._stiffness != 1), np.clip(error, -reach, reach), error)
        limited = np.where(self._powered, limited, 0.0)
        self._duty = np.clip(limited * self._gain / self._strength, -1, 1)
        self._stepper.step((positions + limited)[None])
        self.electrics.advance(self._duty, self._strain, self._step_time)

    def _read_drives(self) -> None:
        """Update the drive states after a register change."""
        drives = [servo.drive for servo in self.servos]
        if len(drives) == len(self._drives) and all(a is b for a, b in zip(drives, self._drives, strict=True)):
            return
        self._drives = drives
        self._powered = np.array([drive.powered for drive in drives])
        self._wanted = self.encoders.positions(np.array([drive.goal for drive in drives]))
        self._speed = np.array([drive.speed for drive in drives])
        self._acceleration = np.array([drive.acceleration for drive in drives])
        self._stiffness = np.array([drive.stiffness for drive in drives])
        self._most = np.array([drive.strength for drive in drives])
        self._deadband = np.array([drive.deadband for drive in drives])
        self._strain = np.array([servo.kind.bounds(servo).strain for servo in self.servos])

    def _approach(self, positions: np.ndarray) -> None:
        """Move the servos' internal goals towards those in the registers, within speed and acceleration limits.

        With an acceleration limit a, the speed at a distance d from the goal is at most sqrt(2·a·d).
        """
        step, left = self._step_time, self._wanted - self._goal
        ramped = np.isfinite(self._acceleration)
        change = np.where(ramped, self._acceleration, 0.0) * step
        braked = np.sqrt(2 * np.where(ramped, self._acceleration, 0.0) * np.abs(left))
        wanted = np.sign(left) * np.minimum(self._speed, braked)
        ramp = np.clip(wanted, self._pace - change, self._pace + change) * step
        ramp = np.where(np.sign(ramp) == np.sign(left), np.sign(left) * np.minimum(np.abs(ramp), np.abs(left)), ramp)
        plain = np.clip(left, -self._speed * step, self._speed * step)
        moved = np.where(self._powered, np.where(ramped, ramp, plain), 0.0)
        self._goal, self._pace = np.where(self._powered, self._goal + moved, positions), moved / step


def read_gains_and_limits(robot: Robot, servos: Sequence[VirtualServo]) -> tuple[np.ndarray, np.ndarray]:
    """Return gain [N m/rad] and largest torque [N m] of each joint's servo in the model, shape (n,) each.

    If the model has no torque limit, the stall torque of the servo is used.
    """
    model, name = robot.spec().compile(), robot.name
    places = [find_actuator_index(model, find_joint_index(model, joint, name), name) for joint in robot.joints]
    stall = [servo.kind.stall_torque for servo in servos]
    limits = np.where(model.actuator_forcelimited[places], model.actuator_forcerange[places, 1], stall)
    return model.actuator_gainprm[places, 0].copy(), limits
