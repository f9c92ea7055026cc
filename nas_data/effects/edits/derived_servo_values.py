"""Values of servos that the compiler derives from their joint, and would derive again after each edit."""

import mujoco

KEPT_RANGE = {
    mujoco.mjtDyn.mjDYN_INTEGRATOR: "act"
}  # whose range is inherited; of all others it is that of the control


def fix_derived_values(spec: mujoco.MjSpec) -> None:
    """Replace damping ratios and inherited ranges by the numbers that they mean in this model.

    Later edits then do not change them. An effect may also move a servo to a tendon or to a joint of its own, which has
    no range to inherit.
    """
    servos = [
        (index, servo) for index, servo in enumerate(spec.actuators) if servo.biasprm[2] > 0 or servo.inheritrange > 0
    ]
    if not servos:
        return
    model = spec.copy().compile()
    for index, servo in servos:
        servo.biasprm = model.actuator_biasprm[index]
        if servo.inheritrange > 0:
            kind = KEPT_RANGE.get(servo.dyntype, "ctrl")
            setattr(servo, f"{kind}range", getattr(model, f"actuator_{kind}range")[index])
            setattr(servo, f"{kind}limited", mujoco.mjtLimited.mjLIMITED_TRUE)
            servo.inheritrange = 0
