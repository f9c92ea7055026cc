"""Physics timestep of an `MjSpec`, with the delays that depend on it."""

import math

import mujoco

ROUNDING = 1e-6  # of a number of samples


def set_timestep(spec: mujoco.MjSpec, timestep: float) -> None:
    """Set the physics timestep [s]; delayed controls and sensors stay as late as they were.

    MuJoCo keeps `nsample` values of each, one per timestep, and takes the oldest for a longer delay.
    """
    ratio = spec.option.timestep / timestep
    for delayed in (*spec.actuators, *spec.sensors):
        delayed.nsample = max(delayed.nsample, math.ceil(delayed.nsample * ratio - ROUNDING))
    spec.option.timestep = timestep
