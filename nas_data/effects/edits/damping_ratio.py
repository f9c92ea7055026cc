"""Damping ratios of servos, which the compiler turns into damping anew after each change of a model."""

import mujoco


def settle_damping(spec: mujoco.MjSpec) -> None:
    """Replace damping ratios by the damping that they stand for in this model, so that no later edit changes it."""
    servos = [(place, servo) for place, servo in enumerate(spec.actuators) if servo.biasprm[2] > 0]
    if not servos:
        return
    model = spec.copy().compile()
    for place, servo in servos:
        servo.biasprm = model.actuator_biasprm[place]
