"""Candidate experiments, each for one property of a drive, whose range is reduced until nothing collides."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nas_data.errors import ModelFileError
from nas_data.excitations.chirp import Chirp
from nas_data.excitations.steps import Steps
from nas_data.excitations.triangle import Triangle
from nas_data.gap.experiments.command_limits import CommandRange, mask_joints
from nas_data.gap.experiments.discrimination import Explanation, make_batch
from nas_data.gap.nominal import Nominal
from nas_data.simulators.contact import count_contacts

SHARES = (1.0, 0.6, 0.35, 0.2, 0.1, 0.05)  # shares of the command range, tried in this order
CONTACT_INTERVAL = 0.05  # [s] between contact checks

SECONDS = 12.0  # [s] duration without the approach
TRANSFER_SPEED = 1.0  # [rad/s or N·m/s; slides m/s or N/s] speed between postures
POSTURES = 4  # postures with small reversals
POSTURE_RANGE = 0.5  # share of a half range that contains the postures
REVERSAL_AMPLITUDE = 0.04  # amplitude of small reversals over a half range, a few times a servo's play
REVERSAL_PERIOD = 1.2  # [s] period of small reversals
POSTURE_SECONDS = 2.4  # [s] duration in each posture
LEVELS = (-0.6, -0.2, 0.2, 0.6, 0.4, 0.0, -0.4)  # of a hold grid over a half range, reached from both sides
MOST_CONCERNED = 2  # most joints that are moved one at a time
HOLD_SECONDS = 1.0  # [s] at each level


@dataclass(frozen=True)
class ExperimentDesign:
    """One experiment.

    Attributes:
        name: Kind of commands.
        moved: Joints that it excites.
        commands: Commands from the rest pose [rad or N·m; slides m or N], shape (T, n).
    """

    name: str
    moved: tuple[str, ...]
    commands: np.ndarray


def draw_small_reversals(room: CommandRange, moving: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw small triangle waves in several postures, which load the joints differently."""
    turns = room.period * np.arange(room.steps(POSTURE_SECONDS)) / REVERSAL_PERIOD
    swing = (2 / np.pi * np.arcsin(np.sin(2 * np.pi * turns)))[:, None] * REVERSAL_AMPLITUDE * room.span * moving
    here, parts = room.home, []
    for posture in room.middle + POSTURE_RANGE * room.span * rng.uniform(-1, 1, (POSTURES, len(room.home))):
        parts += [room.ramp(here, posture, TRANSFER_SPEED), posture + swing]
        here = posture
    return np.concatenate(parts)


def draw_hold_grid(room: CommandRange, moving: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw levels over the range, held and approached slowly from both sides."""
    here, parts = room.home, []
    for level in LEVELS:
        goal = np.where(moving, room.middle + level * room.span, room.home)
        parts += [room.ramp(here, goal, TRANSFER_SPEED), np.repeat(goal[None], room.steps(HOLD_SECONDS), axis=0)]
        here = goal
    return np.concatenate(parts)


Draw = Callable[[CommandRange, np.ndarray, np.random.Generator], np.ndarray]

STEPS = "steps held"
KINDS: Mapping[str, Draw] = {
    "slow triangle": lambda room, moving, rng: room.draw_excitation(
        Triangle(speed=0.4, share=0.5), SECONDS, moving, rng
    ),
    "small reversals around several postures": draw_small_reversals,
    STEPS: lambda room, moving, rng: room.draw_excitation(Steps(seconds=1.5, share=0.6), SECONDS, moving, rng),
    "chirp": lambda room, moving, rng: room.draw_excitation(Chirp(share=0.15, fastest=4.0), SECONDS, moving, rng),
    "fast steps": lambda room, moving, rng: room.draw_excitation(Steps(seconds=0.3, share=0.4), SECONDS, moving, rng),
    "hold grid": draw_hold_grid,
}


def generate_experiments(
    nominal: Nominal, explanation: Explanation, room: CommandRange, concerned: Sequence[str], seed: int
) -> Iterator[ExperimentDesign]:
    """Yield experiments for each concerned joint, and steps of all joints together.

    Experiments that harm the arm even in the smallest range are left out; see `is_harmless`.

    Args:
        nominal: Given model.
        explanation: Explanation by which the arm's motion is predicted.
        room: Range of commands.
        concerned: Joints in which the explanations differ; if there are many, each experiment moves all joints.
        seed: Seed of random excitations.
    """
    whole = nominal.joints
    everywhere = len(concerned) > MOST_CONCERNED or set(concerned) == set(whole)
    if everywhere:
        kinds = [(name, whole) for name in KINDS]
    else:
        kinds = [*((name, (joint,)) for joint in concerned for name in KINDS), (STEPS, whole)]
    for number, (name, moved) in enumerate(kinds):
        for share in SHARES:
            part, rng = room.shrink(share), np.random.default_rng([seed, number])
            commands = part.prepend_approach(KINDS[name](part, mask_joints(whole, moved), rng))
            if is_harmless(nominal, explanation, room, commands):
                yield ExperimentDesign(name, moved, commands)
                break


def is_harmless(nominal: Nominal, explanation: Explanation, room: CommandRange, commands: np.ndarray) -> bool:
    """Whether nothing touches in an experiment that does not touch in the rest pose, and no joint moves too fast.

    Args:
        nominal: Given model.
        explanation: Explanation by which the arm's motion is predicted.
        room: Range of commands, with the largest speeds.
        commands: Commands of the experiment, shape (T, n).
    """
    try:
        path = nominal.predict(make_batch(nominal, [commands], room.pose), explanation.effects, explanation.factors)[0]
    except ModelFileError:
        return False
    if (np.abs(np.diff(path, axis=0)).max(0) > room.fastest * room.period).any():
        return False
    counts = count_contacts(nominal.simulator(), np.array([room.pose, *path[:: room.steps(CONTACT_INTERVAL)]]))
    return bool(counts.max() <= counts[0])
