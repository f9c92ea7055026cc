"""Starts of rollouts from a measured pose: the arm at rest in it, its hidden parts loaded as they would be."""

from dataclasses import dataclass
from enum import IntEnum

import mujoco
import numpy as np

from nas_data.mjcf.actuator_lookup import BAND, GAIN, GOAL
from nas_data.simulators.controls import CONTROLLERS, length_feedback
from nas_data.simulators.layout import Layout, has_memory, settle_actuator

WEIGHTLESS = 1e-4  # [N m] below which a load decides nothing about the side of a play


class InitialLoad(IntEnum):
    """What held a joint in its first pose: no sensor tells."""

    WEIGHT = 0  # the servo held the arm's weight
    NOTHING = 1  # the arm was put there and nothing had settled
    LESS = 2  # friction held a part of the weight
    MORE = 3  # the servo held the weight and friction, too


@dataclass(frozen=True)
class Band:
    """A servo's dead band.

    Attributes:
        goal: Index in qpos of the servo's goal, which the joint is pulled to.
        stiffness: Of the servo [N m/rad].
        half_width: Of the band [rad].
    """

    goal: int
    stiffness: float
    half_width: float

    def edge(self, load: float) -> float:
        """Return the error within the band where it leans on a load [rad]: an edge, or its middle without a load."""
        return 0.0 if abs(load) < WEIGHTLESS else float(np.copysign(self.half_width, load))


def find_band(model: mujoco.MjModel, joint: int) -> Band | None:
    """Return the dead band of a joint's servo, None where it has none."""
    name = model.joint(joint).name
    gain, band = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name + part) for part in (GAIN, BAND))
    if min(gain, band) < 0:
        return None
    stiffness = -float(model.actuator_biasprm[gain, 1])
    goal = int(model.joint(name + GOAL).qposadr[0])
    return Band(goal, stiffness, float(model.actuator_forcerange[band, 1]) / stiffness)


class SettledStates:
    """The full state of a model that has long been held in a posture under its own weight.

    Beyond `RestStates`: springs between servo and link are loaded, play lies on the side to which the load pushes
    (in the middle where nothing does), and delayed or slewing commands are those that hold the load. How much of the
    weight dry friction holds is not known: a `InitialLoad` says what is assumed of each joint.
    """

    def __init__(
        self, model: mujoco.MjModel, layout: Layout, spec: int, period: float, data: mujoco.MjData | None = None
    ) -> None:
        """Prepare the states; arguments as for `RestStates`, the control period [s], and data to work in."""
        self.model, self.layout, self.spec, self.period = model, layout, spec, period
        self.data = data or mujoco.MjData(model)
        self.bands = [find_band(model, int(joint)) for joint in model.dof_jntid[layout.dof]]
        self.remembering = [actuator for actuator in range(len(model.actuator_trntype)) if has_memory(model, actuator)]
        places = range(len(layout.joints))
        self.hidden = [[a for a in np.flatnonzero(layout.position_map[p]) if a != layout.qpos[p]] for p in places]
        feedbacks = [holding_feedback(model, int(actuator)) for actuator in layout.inputs.actuators]
        self.stiffness, self.gear, gain, constant = np.array(feedbacks).reshape(-1, 4).T
        self.holding = layout.inputs.positional & (self.stiffness > 0)
        own = gain * layout.inputs.zero  # of the control's unit
        self.rest = np.divide(constant + own, self.stiffness * self.gear, out=np.zeros_like(own), where=self.holding)

    def __call__(self, states: np.ndarray, holds: np.ndarray, earlier: np.ndarray | None = None) -> np.ndarray:
        """Return full states (B, size) for measured states and holds.

        Args:
            states: Positions [rad] then velocities [rad/s], shape (B, 2n), or with the objects' states (B, 2n + m);
                objects with servos are held where they are.
            holds: What held each joint (a `InitialLoad`), shape (B, n).
            earlier: Commands of the control periods before the start, the last one last, shape (B, L, n); NaN where the
                arm had settled by then, none where None. Delays still hold them.
        """
        known = np.empty((len(states), 0, holds.shape[1])) if earlier is None else earlier
        rows = zip(np.asarray(states, float), holds, known, strict=True)
        return np.stack([self.settled(*row) for row in rows])

    def settled(self, state: np.ndarray, holds: np.ndarray, earlier: np.ndarray) -> np.ndarray:
        """Return the full state for one measured state (2n,) or (2n + m,), its holds (n,), and commands (L, n)."""
        model, data, n = self.model, self.data, len(self.layout.joints)
        objects = self.layout.objects
        mujoco.mj_resetData(model, data)
        data.qpos[self.layout.qpos] = state[:n]
        if len(state) > 2 * n:
            data.qpos[objects.qpos], data.qvel[objects.dof] = np.split(state[2 * n :], [len(objects.qpos)])
        followers = self.layout.followers
        if followers is not None:
            followers.place(data.qpos[None], data.qvel[None], far=True)
        mujoco.mj_forward(model, data)
        weight = data.qfrc_bias - data.qfrc_gravcomp  # of which a controller carries what is compensated
        if followers is not None:  # through the constraints, their weight is the measured joints'
            weight += followers.slopes(data.qpos).T @ weight[followers.dofs]
        loads = self.loads(weight, holds)
        for place in range(n):
            self.load_transmission(place, float(loads[place]))
        holding = np.where(self.layout.inputs.positional, self.holding_commands(loads), 0.0)
        data.ctrl[:] = self.layout.controls(holding, state)
        for actuator in self.remembering:
            settle_actuator(model, data, actuator)
        if len(earlier) and np.isfinite(earlier).all():
            self.fill_delays(self.layout.controls(earlier, state[None]))
        data.qvel[self.layout.dof] = state[n : 2 * n]
        if followers is not None:
            followers.place(data.qpos[None], data.qvel[None])
        full = np.empty(mujoco.mj_stateSize(model, self.spec))
        mujoco.mj_getState(model, data, full, self.spec)
        return full

    def fill_delays(self, controls: np.ndarray) -> None:
        """Fill the actuators' delays with controls of the control periods before the start, shape (L, nu)."""
        model, data = self.model, self.data
        for actuator in np.flatnonzero(model.actuator_history[:, 0]):
            first, inputs = model.actuator_ctrladr[actuator], model.actuator_ctrlnum[actuator]
            ages = model.opt.timestep * np.arange(int(model.actuator_history[actuator, 0]), 0, -1)
            periods = np.ceil(ages / self.period - 1e-6).astype(int)
            values = controls[np.maximum(len(controls) - periods, 0), first : first + inputs]
            mujoco.mj_initCtrlHistory(model, data, int(actuator), -ages[:, None], np.ascontiguousarray(values))

    def loads(self, weight: np.ndarray, holds: np.ndarray) -> np.ndarray:
        """Return the torques [N m] that the servos hold, shape (n,), for the weight on each degree of freedom."""
        friction = np.maximum(self.model.dof_frictionloss[self.layout.dof], 2 * WEIGHTLESS)
        weights = weight[self.layout.dof]
        return np.select(
            [holds == InitialLoad.NOTHING, holds == InitialLoad.LESS, holds == InitialLoad.MORE],
            [np.zeros_like(weights), weights - friction, weights + friction],
            weights,
        )

    def load_transmission(self, place: int, load: float) -> None:
        """Turn the hidden joints between a servo and its link as the load does; the measured position stays."""
        model, data, own = self.model, self.data, self.layout.qpos[place]
        for address in self.hidden[place]:
            joint = int(np.flatnonzero(model.jnt_qposadr == address)[0])
            stiffness = float(model.jnt_stiffness[joint])
            turned = -load / stiffness if stiffness > 0 else 0.0
            if model.jnt_limited[joint]:
                low, high = model.jnt_range[joint]
                fallen = 0.0 if abs(load) < WEIGHTLESS else low if load > 0 else high
                turned = float(np.clip(turned, low, high)) if stiffness > 0 else fallen
            data.qpos[address] = turned
            data.qpos[own] -= turned

    def holding_commands(self, loads: np.ndarray) -> np.ndarray:
        """Return the commanded positions (n,) at which the servos hold the loads; saturation is left out.

        A servo with a dead band has its goal put there, too: beyond the edge of the band that the load leans on.
        """
        commands = self.data.qpos[self.layout.qpos].copy()
        for place in np.flatnonzero(self.holding):
            load, stiffness, rest = float(loads[place]), self.stiffness[place], self.rest[place]
            if (band := self.bands[place]) is None:
                commands[place] += load / (stiffness * self.gear[place] ** 2) - rest
            else:
                commands[place] += load / band.stiffness + band.edge(load) - rest
                self.data.qpos[band.goal] = commands[place] + rest
        return commands


def holding_feedback(model: mujoco.MjModel, actuator: int) -> tuple[float, float, float, float]:
    """Return force per error of an actuator's length, gear, force per control, and constant force."""
    stiffness, gear = length_feedback(model, actuator), float(model.actuator_gear[actuator, 0])
    is_controller = model.actuator_gaintype[actuator] in CONTROLLERS
    gain = stiffness if is_controller else float(model.actuator_gainprm[actuator, 0])
    return stiffness, gear, gain, float(model.actuator_biasprm[actuator, 0])
