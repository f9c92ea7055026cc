"""Saturation: servos of the model at their torque limits, and commands outside its control range."""

import numpy as np

from nas_data.count_of import join_items
from nas_data.gap.finding.audits.base import Examined, format_percent
from nas_data.gap.report_parts import Check
from nas_data.simulators.limits import command_limits

NAME = "saturation"
REPORTED_SHARE = 0.01  # share of the rows above which a joint is reported
EXCESSIVE_SHARE = 0.5  # share of the rows at the limit above which the gain is too high
ROUNDING = 1e-5  # [the commands' unit]; commands are stored as float32


def check(examined: Examined) -> Check:
    """Report the joints at their limits."""
    counts = examined.recorded.evidence.mask
    saturated = examined.loads.saturated[counts].mean(axis=0)
    beyond = find_out_of_range(examined)[counts].mean(axis=0)
    said = []
    if (saturated > REPORTED_SHARE).any():
        said.append(f"the model's servo is at its torque limit in {describe_shares(examined, saturated)}")
    if (saturated > EXCESSIVE_SHARE).any():
        said.append("most of the time at the limit is a gain (kp) too high for its torque: look at the model")
    if (beyond > REPORTED_SHARE).any():
        said.append(
            f"commands leave the model's range in {describe_shares(examined, beyond)}: the model cuts them off, "
            "the robot may have done otherwise"
        )
    if not said:
        return Check(NAME, "The model's servos are below their torque limits and the commands within its ranges.")
    text = "; ".join(said)
    return Check(
        NAME, text[0].upper() + text[1:] + ".", not ((saturated > EXCESSIVE_SHARE) | (beyond > REPORTED_SHARE)).any()
    )


def describe_shares(examined: Examined, values: np.ndarray) -> str:
    """Return joints with their shares of the rows, above `REPORTED_SHARE`."""
    pairs = zip(examined.nominal.joints, values, strict=True)
    return join_items(
        [f"{format_percent(value)} of the rows of {joint}" for joint, value in pairs if value > REPORTED_SHARE]
    )


def find_out_of_range(examined: Examined) -> np.ndarray:
    """Return which commands lie outside the model's range, shape (E, T, n)."""
    simulator = examined.nominal.simulator()
    low, high = command_limits(simulator.model, simulator.joints, str(simulator.robot.mjcf))
    commands = examined.recorded.evidence.commands
    return np.asarray((commands < low - ROUNDING) | (commands > high + ROUNDING))
