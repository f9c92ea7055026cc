"""Fixation of floating bases, whose poses are not measured, at their poses in the model."""

import mujoco
import numpy as np

from nas_data.mjcf.actuator_lookup import find_driven_joint
from nas_data.mjcf.base_contacts import exclude_base_contacts

FREE_DOFS = 6  # degrees of freedom of a free joint
LEVER = 1e-9  # smallest singular value of a constrained direction


def find_floating_bases(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Return the names of bodies with a free joint that carry a driven joint and that no constraint fixes."""
    driven = {find_driven_joint(spec, actuator) for actuator in spec.actuators} - {None}
    bases = [joint.parent for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    carrying = [base for base in bases if any(joint.name in driven for joint in base.find_all("joint"))]
    if not carrying:
        return ()
    model = spec.copy().compile()
    return tuple(base.name for base in carrying if not is_fixed(model, base.id))


def is_fixed(model: mujoco.MjModel, body: int) -> bool:
    """Whether equality constraints fix a body with a free joint."""
    model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    rows = data.efc_J.reshape(-1, model.nv)[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]
    first = int(model.body_dofadr[body])
    return bool(np.linalg.matrix_rank(rows[:, first : first + FREE_DOFS], tol=LEVER) == FREE_DOFS)


def fix_bases(spec: mujoco.MjSpec) -> None:
    """Fix floating bases to the world: remove their free joints, also from the keyframes.

    The links that joints connect to a base do not collide with it, fixed or not.
    """
    for base in find_floating_bases(spec):
        model = spec.copy().compile()
        exclude_base_contacts(spec, int(model.body(base).id))
        joint = next(j for j in spec.body(base).joints if j.type == mujoco.mjtJoint.mjJNT_FREE)
        compiled = model.joint(int(model.body_jntadr[model.body(base).id]))
        positions, speeds = int(compiled.qposadr[0]), int(compiled.dofadr[0])
        spec.delete(joint)
        for number, key in enumerate(spec.keys):
            key.qpos = np.delete(model.key_qpos[number], np.arange(positions, positions + 7))
            key.qvel = np.delete(model.key_qvel[number], np.arange(speeds, speeds + 6))
