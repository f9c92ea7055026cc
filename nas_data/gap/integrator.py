"""Integrator and timestep for a model with stiff effects."""

import mujoco
import numpy as np

from nas_data.mjcf.timestep import set_timestep

STAGES = 4  # evaluations per step of RK4; as many steps of another integrator cost the same
FINE_TIMESTEP = 0.0005  # [s] timestep whose discretisation error is below sensor noise


def find_whole_step(period: float, timestep: float) -> float:
    """Return the longest timestep up to a given one that divides a control period [s]."""
    return float(period / np.ceil(period / timestep - 1e-6))


def find_longest_step(model: mujoco.MjModel) -> float:
    """Return the longest physics step [s] that resolves the stiffest contact pair, limit and equality of a model.

    MuJoCo softens constraints whose time constant is below two steps (MuJoCo documentation, `refsafe`).
    """
    limited = model.jnt_limited.astype(bool), model.tendon_limited.astype(bool)
    solref = [model.pair_solref, model.jnt_solref[limited[0]], model.tendon_solref_lim[limited[1]], model.eq_solref]
    constants = np.concatenate(solref)[:, 0]
    return float(constants[constants > 0].min(initial=np.inf)) / 2  # negative values are stiffnesses


def make_implicit(spec: mujoco.MjSpec, period: float) -> str:
    """Set an integrator with implicit damping if the model's own is explicit; return a note, else an empty string.

    Dead bands and LuGre friction are too stiff for explicit integration.

    Args:
        spec: Model, which is edited.
        period: Control period [s].
    """
    option = spec.option
    explicit_damping = bool(option.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP))
    if option.integrator == int(mujoco.mjtIntegrator.mjINT_RK4):
        own = "RK4"
        longest = min(option.timestep, max(option.timestep / STAGES, FINE_TIMESTEP))
        set_timestep(spec, find_whole_step(period, longest))
    elif option.integrator == int(mujoco.mjtIntegrator.mjINT_EULER) and explicit_damping:
        own = "Euler without implicit damping"
    else:
        return ""
    option.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    return (
        f"The model's integrator, {own}, diverges with stiff effects (dead band, Stribeck friction): it is replaced by "
        f"implicitfast, here and in model.xml, at {1e3 * option.timestep:.3g} ms."
    )
