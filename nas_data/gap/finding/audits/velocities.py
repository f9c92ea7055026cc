"""Velocities: whether the recorded ones belong to the recorded positions, in size and in time."""

import numpy as np

from nas_data.gap.finding.audits.base import Check, Examined, listed
from nas_data.gap.finding.audits.repeated_samples import derived
from nas_data.gap.finding.recorded import Recorded

NAME = "velocities"
LATEST = 6  # [rows] latest register that is looked for
LATE = 1.0  # [rows] delay that is reported; a backward difference has half a row
ALIKE = 0.8  # correlation below which a register is not that joint's velocity
SIZE = 1.2  # factor between register and difference that is worth a word
ENOUGH = 50  # rows in motion


def check(examined: Examined) -> Check:
    """Compare each joint's register with its differenced position."""
    recorded = examined.recorded
    if derived(recorded):
        return Check(NAME, "Velocities were derived from the positions; one-step errors carry their noise.")
    moving = recorded.moving(examined.floor)
    said = [text for joint in range(len(examined.floor)) if (text := judge(recorded, joint, moving[..., joint]))]
    if said:
        advice = "; one-step predictions start where the arm never was: import again with velocity = 'derive'."
        return Check(NAME, listed(said) + advice, False)
    return Check(NAME, "The recorded velocities are those of the positions, in size and in time.")


def judge(recorded: Recorded, joint: int, moving: np.ndarray) -> str:
    """Say what is wrong with one joint's velocities, nothing where they fit or too little moves."""
    name = recorded.evidence.joints[joint]
    if moving.sum() < ENOUGH:
        return ""
    delays = np.arange(-1, LATEST + 0.5, 0.5)
    fits = [compare(recorded, joint, float(delay)) for delay in delays]
    likeness, factor = fits[int(np.argmax([abs(like) for like, _ in fits]))]
    delay = float(delays[int(np.argmax([abs(like) for like, _ in fits]))])
    if abs(likeness) < ALIKE:
        return f"the velocity of {name} hardly follows its position (correlation {likeness:.2f})"
    if factor < 0:
        return f"the velocity of {name} has the opposite sign of its motion"
    if not 1 / SIZE < factor < SIZE:
        return f"the velocity of {name} is {factor:.3g} times that of its position"
    if delay >= LATE:
        return f"the velocity of {name} is {delay * recorded.evidence.period * 1e3:.2g} ms behind its position"
    return ""


def compare(recorded: Recorded, joint: int, delay: float) -> tuple[float, float]:
    """Return correlation and size of the register against the motion so many rows earlier."""
    products = np.zeros(3)
    for episode, counts in enumerate(recorded.evidence.counts):
        length = int(counts.sum())
        position = recorded.positions[episode, :length, joint]
        reach = min(recorded.reach, (length - 1) // 2)
        middle = np.arange(reach, length - reach)
        speed = (position[2 * reach :] - position[: length - 2 * reach]) / (2 * reach * recorded.evidence.period)
        smooth = smoothed(recorded.velocities[episode, :length, joint], reach)
        inner = middle[LATEST + 1 : len(middle) - 1]
        earlier, register = np.interp(inner - delay, middle, speed), smooth[inner]
        products += [earlier @ register, earlier @ earlier, register @ register]
    likeness = products[0] / max(np.sqrt(products[1] * products[2]), 1e-12)
    return float(likeness), float(products[0] / max(products[1], 1e-12))


def smoothed(register: np.ndarray, reach: int) -> np.ndarray:
    """Return the register's mean over as long as the difference of positions spans, trapezoid rule; shape (T,)."""
    weights = np.ones(2 * reach + 1)
    weights[[0, -1]] = 0.5
    return np.convolve(register, weights / weights.sum(), mode="same")
