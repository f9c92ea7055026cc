"""The larger gap of the paper's appendix A.2: a heavier arm and object, and a table that brakes more."""

import mujoco

ARM = 1.5  # mass and inertia of the arm, + 50 %
OBJECT = 2.0  # mass and inertia of the object, + 100 %
TABLE = 6.0  # friction of the table, + 500 %


def widen_gap(spec: mujoco.MjSpec, joint: str, object_body: str | None = None) -> None:
    """Change a model as in the appendix, without the backlash.

    Args:
        spec: Model.
        joint: First joint of the arm.
        object_body: The object; the damping of its slides is its friction on the table. None for no object.
    """
    scale_mass(spec.joint(joint).parent, ARM)
    if object_body is None:
        return
    body = spec.body(object_body)
    scale_mass(body, OBJECT)
    for slide in body.joints:
        slide.damping = slide.damping * TABLE


def scale_mass(body: mujoco.MjsBody, factor: float) -> None:
    """Scale mass and inertia of a body and of all its descendants, in whatever form they are specified."""
    body.mass, body.inertia = body.mass * factor, body.inertia * factor
    body.fullinertia = body.fullinertia * factor
    for geom in body.geoms:
        geom.mass, geom.density = geom.mass * factor, geom.density * factor
    for child in body.bodies:
        scale_mass(child, factor)
