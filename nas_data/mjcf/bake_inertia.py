"""Explicit masses and inertias, so that a model does not depend on the geoms from which they were computed."""

import mujoco
import numpy as np

from nas_data.mjcf.unique_name import make_unique_name

DISABLED = -1.0  # value of `settotalmass` that disables it


def bake_inertia(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return the model with explicit mass and inertia for every moving body.

    Compiler options that change masses (`settotalmass`, `boundmass` and the like) are applied and then disabled.
    Otherwise they would also change bodies that are added later.
    """
    result = spec.copy()
    for number, body in enumerate(result.bodies):
        body.name = body.name or make_unique_name(result.body, f"body{number}")
    model = result.copy().compile()
    result.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    result.compiler.settotalmass, result.compiler.balanceinertia = DISABLED, False
    result.compiler.boundmass = result.compiler.boundinertia = 0.0
    kept = {model.body(index).name for index in range(model.nbody)}  # of a URDF, bodies without a joint are fused
    for body in result.bodies[1:]:
        if body.name not in kept:
            continue
        compiled = model.body(body.name)
        if compiled.mass[0] <= 0 and not compiled.inertia.any():
            continue
        body.explicitinertial = True
        body.mass = float(compiled.mass[0])
        body.inertia, body.ipos, body.iquat = compiled.inertia, compiled.ipos, compiled.iquat
        body.fullinertia = np.full(6, np.nan)
    return result


def rescales_masses(spec: mujoco.MjSpec) -> bool:
    """Whether compiler options would also change the mass of a body that is added."""
    compiler = spec.compiler
    return bool(compiler.settotalmass > 0 or compiler.boundmass > 0 or compiler.boundinertia > 0)
