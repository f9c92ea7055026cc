"""Fit every parameter at once, as `mujoco.sysid` does, and name the one that moved farthest."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
from mujoco import minimize

from nas_data.benchmarks.blind.baselines.base import Claim, RecordedCase, claim
from nas_data.benchmarks.blind.fresh import Delivered, find_actuators
from nas_data.simulators.layout import FULLPHYSICS, Layout
from nas_data.simulators.rest_states import RestStates

EPISODES = 8  # episodes to fit; all of them give the same names in more than twice the time
ITERATIONS = 8
WIDEST = np.log(20.0)  # largest factor
TOLERATED = np.log(1.25)  # base parameters may be off by this factor without a missing effect
STEP = 1e-3  # finite difference of a logarithm: rollouts with dry friction are too rough for smaller ones
# each parameter's name, and the effect of the contract's table that it corresponds to
PARAMETERS = {
    "kp": "servo_stiffness",
    "damping": "viscous_friction",
    "frictionloss": "coulomb_friction",
    "armature": "rotor_inertia",
    "mass": "payload",
}


@dataclass(frozen=True)
class SysidProblem:
    """A model with all parameters free, and the episodes to fit."""

    model: mujoco.MjModel  # compiled nominal model
    layout: Layout  # its measured joints
    recorded: RecordedCase  # episodes to fit
    substeps: int  # physics steps per control period

    def changed(self, logarithms: np.ndarray) -> mujoco.MjModel:
        """Return the model with each parameter times the exponential of its logarithm, shape (5 n,)."""
        model, layout = self.model.__copy__(), self.layout
        kp, damping, friction, armature, mass = np.exp(logarithms).reshape(len(PARAMETERS), -1)
        actuators = layout.control
        model.actuator_gainprm[actuators, 0] *= kp
        model.actuator_biasprm[actuators, 1] *= kp
        model.actuator_biasprm[actuators, 2] *= damping
        model.dof_damping[layout.dof] = (model.dof_damping[layout.dof].T * damping).T
        model.dof_frictionloss[layout.dof] *= friction
        model.dof_armature[layout.dof] *= armature
        bodies = model.dof_bodyid[layout.dof]
        model.body_mass[bodies] *= mass
        model.body_inertia[bodies] *= mass[:, None]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def residual(self, columns: np.ndarray) -> np.ndarray:
        """Return simulated minus measured positions [rad] for each column of logarithms: (residuals, columns)."""
        columns = columns.reshape(len(columns), -1)
        return np.stack([self._compute_misfit(self.changed(column)) for column in columns.T], axis=1)

    def _compute_misfit(self, model: mujoco.MjModel) -> np.ndarray:
        commands, first = self.recorded.commands[:EPISODES], self.recorded.states[:EPISODES, 0].copy()
        if self.layout.inputs.positional.all():  # under torque commands, nothing holds an arm at rest
            first[:, len(self.recorded.joints) :] = 0
        controls = np.repeat(self.layout.controls(commands), self.substeps, axis=1)
        start = RestStates(model, self.layout, FULLPHYSICS)(first)
        full, _ = mujoco.rollout.rollout(model, mujoco.MjData(model), start, controls, nstep=controls.shape[1])
        ends = full[:, self.substeps - 1 :: self.substeps, 1 : 1 + model.nq]
        return np.asarray((ends @ self.layout.position_map.T - self.recorded.positions[:EPISODES, 1:]).reshape(-1))


def answer(dataset: Path, model: Path) -> Claim:
    """Fit gains, damping, friction, rotor inertia and masses; name the parameter that moved farthest, if any."""
    recorded = RecordedCase.load(dataset)
    compiled = mujoco.MjModel.from_xml_path(str(model))
    substeps = int(np.ceil(1 / recorded.rate / compiled.opt.timestep - 1e-6))
    compiled.opt.timestep = 1 / recorded.rate / substeps
    fit = SysidProblem(compiled, Layout.of(compiled, recorded.joints, str(model)), recorded, substeps)
    count = len(PARAMETERS) * len(recorded.joints)
    bounds = [np.full((count, 1), -WIDEST), np.full((count, 1), WIDEST)]
    best, _ = minimize.least_squares(
        np.zeros(count), fit.residual, bounds, eps=STEP, max_iter=ITERATIONS, verbose=0, x_scale="jac"
    )
    logarithms = np.asarray(best).reshape(-1)
    doubts = compute_half_widths(fit, logarithms)
    servos = find_actuators(model, recorded.joints)
    fitted = Delivered.of(fit.changed(logarithms), recorded.joints, servos, recorded.rate, model)
    out = np.abs(logarithms) - doubts - TOLERATED
    worst = int(np.argmax(out))
    kind, row = divmod(worst, len(recorded.joints))
    effect = list(PARAMETERS.values())[kind]
    joint = None if effect == "payload" else recorded.joints[row]
    return Claim((claim(effect, joint),) if out[worst] > 0 else (), fitted.play)


def compute_half_widths(fit: SysidProblem, logarithms: np.ndarray) -> np.ndarray:
    """Return half widths of 95 % intervals under independent residuals, shape (5 n,), as in `mujoco.sysid`."""
    around = np.concatenate([np.zeros((len(logarithms), 1)), STEP * np.eye(len(logarithms))], axis=1)
    columns = fit.residual(logarithms[:, None] + around)
    residual, jacobian = columns[:, 0], (columns[:, 1:] - columns[:, :1]) / STEP
    variance = residual @ residual / (len(residual) - len(logarithms))
    return np.asarray(1.96 * np.sqrt(variance * np.diag(np.linalg.pinv(jacobian.T @ jacobian))))
