"""What the simulated servos move: any simulator of the arm, driven by their registers, read back into them."""

from collections.abc import Sequence

import numpy as np

from nas_data.robots.base import Robot
from nas_data.simulators.base import Simulator
from nas_data.virtual_bus.electrics import Electrics
from nas_data.virtual_bus.servo import Servo
from nas_data.xl320.joints import Joints
from nas_data.xl320.units import LOAD_UNIT, SPEED_UNIT, VOLT, sign_magnitude

STEP = 0.002  # [s] by which the arm advances: the model's own time step
LONGEST = 2.0  # [s] that a body catches up with after its process stood still
GAIN = 32  # value of the P register at which the servo is as stiff as the model
FULL = 1023
STILL = 0.05  # [rad/s] below which a servo does not say that it moves


class Body:
    """An arm in a simulator, at rest at first.

    A servo's gain and torque limit act on the command that the simulator is given; the integral and derivative gain,
    which the model lacks, do nothing. Without torque the command follows the joint, so that friction alone holds it.

    Attributes:
        servos: One a joint.
        joints: How their positions are counted.
        electrics: Their supply and warmth.
        time: Until when the arm has moved [s].
        renewal: Time between two renewals of the servos' readings [s]; with every step where 0.
    """

    def __init__(self, simulator: Simulator, robot: Robot, servos: Sequence[Servo], joints: Joints) -> None:
        """Put servos into an arm.

        Args:
            simulator: The arm, with a period of `STEP`.
            robot: Its model, which says how strong and stiff the servos are.
            servos: One a joint, in the order of the joints.
            joints: How their positions are counted.
        """
        self._stepper = simulator.stepper(1)
        self.servos, self.joints = list(servos), joints
        self.electrics = Electrics(len(self.servos))
        self.time = self._renewed = 0.0
        self.renewal = 0.0
        model = robot.spec().compile()
        self._gain, self._strength = model.actuator_gainprm[:, 0].copy(), model.actuator_forcerange[:, 1].copy()
        self._duty = np.zeros(len(self.servos))
        self._goal = self.positions.copy()
        self.sense()

    @property
    def positions(self) -> np.ndarray:
        """Where the joints are [rad], shape (n,)."""
        return np.asarray(self._stepper.states[0, : len(self.servos)])

    def place(self, state: np.ndarray) -> None:
        """Put the arm into a state, positions [rad] then velocities [rad/s], shape (2n,)."""
        self._stepper.reset(state[None])
        self._goal = self.positions.copy()
        self.sense()

    def advance_to(self, time: float) -> None:
        """Let the arm move until a time [s] on its own clock, then renew the servos' readings."""
        if time - self.time > LONGEST:
            self.time = time - LONGEST
        steps = int((time - self.time) / STEP + 1e-9)
        for _ in range(steps):
            self._step()
        self.time += steps * STEP
        if self.time - self._renewed >= max(self.renewal, STEP) - 1e-9:
            self._renewed = self.time
            self.sense()

    def sense(self) -> None:
        """Write what the servos measure into their registers, and let them fail where they must."""
        n = len(self.servos)
        states = self._stepper.states[0]
        raw = self.joints.raw(states[:n])
        speeds = self.joints.signs * states[n:]
        efforts = self.joints.signs * self._duty
        errors = self.electrics.errors(*self._tolerances())
        for place, servo in enumerate(self.servos):
            servo.put("present_position", int(np.clip(raw[place], 0, FULL)))
            servo.put("present_speed", sign_magnitude(speeds[place] / SPEED_UNIT))
            servo.put("present_load", sign_magnitude(efforts[place] / LOAD_UNIT))
            servo.put("present_voltage", round(self.electrics.voltage / VOLT))
            servo.put("present_temperature", int(np.clip(round(self.electrics.temperature[place]), 0, 255)))
            servo.put("moving", int(abs(speeds[place]) > STILL))
            if errors[place]:
                servo.fail(int(errors[place]))

    def _step(self) -> None:
        """Advance by one step under the goals, gains and limits that the servos hold now."""
        positions = self.positions
        powered = self._register("torque_enable") > 0
        self._approach(positions, powered)
        most = np.minimum(self._register("torque_limit"), self._register("max_torque")) / FULL
        error = self._register("p_gain") / GAIN * (self._goal - positions)
        reach = most * self._strength / self._gain
        limited = np.where((most < 1) | (self._register("p_gain") != GAIN), np.clip(error, -reach, reach), error)
        limited = np.where(powered, limited, 0.0)
        self._duty = np.clip(limited * self._gain / self._strength, -1, 1)
        self._stepper.step((positions + limited)[None])
        self.electrics.advance(self._duty, STEP)

    def _approach(self, positions: np.ndarray, powered: np.ndarray) -> None:
        """Move the servos' inner goals towards those in the registers, as fast as the moving speed allows."""
        wanted = self.joints.positions(self._register("goal_position"))
        speed = self._register("moving_speed") & FULL
        far = np.where(speed > 0, speed * SPEED_UNIT * STEP, np.inf)
        self._goal = np.where(powered, self._goal + np.clip(wanted - self._goal, -far, far), positions)

    def _register(self, name: str) -> np.ndarray:
        return np.array([servo.get(name) for servo in self.servos])

    def _tolerances(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return lowest and highest voltage [V] and highest temperature [°C] that each servo bears."""
        lowest, highest = self._register("lowest_voltage") * VOLT, self._register("highest_voltage") * VOLT
        return lowest, highest, self._register("temperature_limit").astype(float)
