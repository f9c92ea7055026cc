"""The integrator and the physics step with which a model is simulated: neither stiff effects nor a rate upset them."""

import mujoco
import numpy as np

STAGES = 4  # evaluations in a step of RK4; as many steps of another integrator cost the same and are as good here
FINE = 0.0005  # [s] physics step at which what a step of finite length does is below any sensor's noise


def whole_step(period: float, timestep: float) -> float:
    """Return the longest physics step up to one of which whole numbers make a control period [s]."""
    return float(period / np.ceil(period / timestep - 1e-6))


def make_implicit(spec: mujoco.MjSpec, period: float) -> str:
    """Give a model an integrator that takes damping implicitly, where its own does not; say so, else return nothing.

    A servo with a dead band and bristles are stiffer than what an explicit step can follow.

    Args:
        spec: Model.
        period: Control period [s].
    """
    option = spec.option
    explicit_damping = bool(option.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP))
    if option.integrator == int(mujoco.mjtIntegrator.mjINT_RK4):
        own = "RK4"
        option.timestep = whole_step(period, min(option.timestep, max(option.timestep / STAGES, FINE)))
    elif option.integrator == int(mujoco.mjtIntegrator.mjINT_EULER) and explicit_damping:
        own = "Euler without implicit damping"
    else:
        return ""
    option.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    return (
        f"The model's integrator, {own}, diverges with stiff effects (dead band, Stribeck friction): here and in "
        f"model.xml it is implicitfast, at {1e3 * option.timestep:.3g} ms."
    )
