"""Damping ratios of servos, from which the compiler would compute other damping after each edit."""

import mujoco


def settle_damping(spec: mujoco.MjSpec) -> None:
    """Replace damping ratios by the damping that they mean in this model, so that later edits do not change it."""
    servos = [(index, servo) for index, servo in enumerate(spec.actuators) if servo.biasprm[2] > 0]
    if not servos:
        return
    model = spec.copy().compile()
    for index, servo in servos:
        servo.biasprm = model.actuator_biasprm[index]
