"""An arm as the leanest Gymnasium environment: one `MjData`, stepped and read, no task and no wrappers."""

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces

from nas_data.simulators.layout import FULLPHYSICS
from nas_data.simulators.mujoco import MujocoSimulator


class GymArm(gymnasium.Env[np.ndarray, np.ndarray]):
    """A robot in MuJoCo; observed are positions [rad] then velocities [rad/s], actions are position commands [rad].

    Leaner than Gymnasium's own `MujocoEnv` (no reward, no rendering, no second forward pass), so that what stepping
    environments costs is not made to look worse than it is.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (not a ClassVar: Gymnasium's base class declares it as it is)

    def __init__(self, simulator: MujocoSimulator) -> None:
        """Take the model and where its joints lie from a simulator."""
        n = len(simulator.joints)
        self.model, self.layout, self.substeps = simulator.model, simulator.layout, simulator.substeps
        self.data = mujoco.MjData(self.model)
        self.control_rate = 1 / simulator.period  # [Hz]
        self._rest = simulator.rest(np.zeros((1, 2 * n)))[0]
        self.observation_space = spaces.Box(-np.inf, np.inf, (2 * n,), np.float32)
        self.action_space = spaces.Box(-np.pi, np.pi, (n,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """Start at rest at zero; `options={"settle": seconds}` holds that pose for a while first."""
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, self._rest, FULLPHYSICS)
        settle = float(str((options or {}).get("settle", 0.0)))
        for _ in range(round(settle * self.control_rate)):
            self.step(np.zeros(len(self.layout.joints)))
        return self._observe(), {}

    def set_state(self, state: np.ndarray) -> None:
        """Set the joints [rad, rad/s], shape (2n,), and forget what the solver knew of another state."""
        n = len(self.layout.joints)
        self.data.qpos[self.layout.qpos] = state[:n]
        self.data.qvel[self.layout.dof] = state[n:]
        self.data.qacc_warmstart[:] = 0.0

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        """Hold the commands for one control period."""
        self.data.ctrl[self.layout.control] = self.layout.inputs.from_commands(action)
        mujoco.mj_step(self.model, self.data, nstep=self.substeps)
        return self._observe(), 0.0, False, False, {}

    def _observe(self) -> np.ndarray:
        return self.layout.measure(self.data.qpos, self.data.qvel).astype(np.float32)
