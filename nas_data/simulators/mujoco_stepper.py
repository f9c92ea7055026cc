"""Closed loops of one MuJoCo model: a batch of simulations stepped together."""

from typing import TYPE_CHECKING

import mujoco
import mujoco.batch
import numpy as np

from nas_data.errors import ModelFileError
from nas_data.mjcf.engine_warnings import collect_instability
from nas_data.simulators.hooks import HookedBatch
from nas_data.simulators.layout import INTEGRATION
from nas_data.simulators.rest_states import RestStates

if TYPE_CHECKING:
    from nas_data.simulators.mujoco import MujocoSimulator


def as_slice(indices: np.ndarray) -> np.ndarray | slice:
    """Return consecutive indices as a slice, which NumPy reads and writes several times faster, else the indices."""
    first = int(indices[0])
    consecutive = np.array_equal(indices, np.arange(first, first + len(indices)))
    return slice(first, first + len(indices)) if consecutive else indices


class MujocoStepper:
    """A batch of simulations of one model in a closed loop; implements `Stepper`.

    Attributes:
        batch: The engine's batch; it can hold model parameters that differ between simulations.
    """

    def __init__(self, simulator: "MujocoSimulator", size: int) -> None:
        """Create the batch; every simulation is at rest at zero."""
        self.simulator = simulator
        self.layout = simulator.layout
        self.joints = simulator.joints
        self.size = size
        # persistent: `site_positions` and the next step share the forward computation
        self.batch = mujoco.batch.Batch(simulator.model, nsim=size, nthread=1, persistent=True)
        self._rest = RestStates(simulator.model, self.layout, INTEGRATION)
        self._qpos = self.batch.bind("qpos")
        self._qvel = self.batch.bind("qvel")
        self._ctrl = self.batch.bind("ctrl")
        self._time = self.batch.bind("time")
        self._inputs, self._converts = self.layout.inputs, not self.layout.inputs.are_commands
        self._diverged = np.zeros(size, bool)
        self._sites = self.batch.bind("site_xpos") if simulator.model.nsite else None
        self._sites_outdated = True
        self._measured: np.ndarray | None = None
        self._servos = tuple(as_slice(indices) for indices in (self.layout.qpos, self.layout.dof, self.layout.control))
        self._hooked = HookedBatch(self.batch, simulator.hooks) if simulator.hooks else None
        self.reset(np.zeros((size, 2 * len(self.joints))))

    @property
    def states(self) -> np.ndarray:
        """Measured positions [rad] then velocities [rad/s], shape (B, 2n); NaN where a simulation diverged."""
        if self._measured is None:
            self._measured = self.layout.measure(self._qpos, self._qvel)
            self._measured[self._diverged] = np.nan
        return self._measured.copy()

    @property
    def objects(self) -> np.ndarray:
        """States of the objects, shape (B, m); see `Stepper.objects`."""
        return self.layout.objects.measure(self._qpos, self._qvel)

    def reset(self, states: np.ndarray, rows: np.ndarray | None = None) -> None:
        """Reset simulations; see `Stepper.reset`."""
        chosen = slice(None) if rows is None else rows
        self.batch.state[chosen] = self._rest(np.asarray(states, float))
        self._diverged[chosen] = False
        self._sites_outdated, self._measured = True, None
        if self._hooked:
            self._hooked.refresh(rows)

    def command_objects(self, targets: np.ndarray, rows: np.ndarray) -> None:
        """Command the servos of objects; see `Stepper.command_objects`."""
        objects = self.layout.objects
        self._ctrl[np.ix_(rows, objects.control)] = objects.inputs.from_commands(targets)

    def step(self, commands: np.ndarray) -> np.ndarray:
        """Hold the commands for one control period; see `Stepper.step`."""
        _, _, control = self._servos
        self._ctrl[:, control] = self._inputs.from_commands(commands) if self._converts else commands
        expected = self._time + self.simulator.period
        with collect_instability():
            if self._hooked:
                self._hooked.step(self.simulator.substeps)
            else:
                self.batch.step(nstep=self.simulator.substeps)
        # MuJoCo resets a diverged simulation to the reference posture and its time to zero
        self._diverged |= ~(np.abs(self._time - expected) < self.simulator.model.opt.timestep / 2).reshape(self.size)
        self._sites_outdated, self._measured = True, None
        return self.states

    def set_states(self, states: np.ndarray) -> None:
        """Move the servos so that the measured state becomes `states`; hidden joints, such as play, keep theirs.

        Followers are moved along, and keep their deviation from the constraints (see `Slack`). A simulation that
        diverged stays so until it is reset.
        """
        change = states - self.states
        change[~np.isfinite(change).all(axis=1)] = 0.0
        n = len(self.joints)
        qpos, dof, _ = self._servos
        followers = self.layout.followers
        slack = None if followers is None else followers.measure_slack(self._qpos, self._qvel)
        self._qpos[:, qpos] += change[:, :n]
        self._qvel[:, dof] += change[:, n:]
        if followers is not None and slack is not None:
            followers.place_with_slack(slack, self._qpos, self._qvel)
        self._sites_outdated, self._measured = True, None

    def site_positions(self, name: str) -> np.ndarray:
        """Return the world position of a site [m], shape (B, 3).

        Raises:
            ModelFileError: the model has no such site.
        """
        site = mujoco.mj_name2id(self.simulator.model, mujoco.mjtObj.mjOBJ_SITE, name)
        if site < 0 or self._sites is None:
            raise ModelFileError(f"{self.simulator.robot.mjcf} has no site '{name}'; add <site name='{name}'/>.")
        if self._sites_outdated:
            self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
            self._sites_outdated = False
        return self._sites[:, site].copy()
