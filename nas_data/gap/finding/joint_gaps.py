"""One-step and open-loop gap of each joint, beside the baselines hold and command and the repeatability.

Repeatability is the difference between repeats of the same commands, which no model of the commands explains.
"""

from collections import defaultdict

import numpy as np

from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding.recorded import RecordedRows
from nas_data.gap.nominal import Nominal
from nas_data.gap.report_parts import JointGap
from nas_data.joint_units import find_joint_unit

SAME_START = 4.0  # noise floors within which repeats must start


def find_joint_gaps(
    recorded: RecordedRows, nominal: Nominal, floor: np.ndarray, predicted: np.ndarray
) -> dict[str, JointGap]:
    """Return the gap of each joint.

    Args:
        recorded: Measured rows, E episodes of up to T rows of n joints.
        nominal: Model.
        floor: Noise floor [rad; m], shape (n,).
        predicted: The model's open-loop positions [rad; m], shape (E, T, n).
    """
    evidence = recorded.evidence
    stepped = nominal.step(evidence, np.concatenate([recorded.positions, recorded.velocities, evidence.objects], -1))
    open_loop = rmse(evidence, predicted)
    commands = None if not nominal.simulator().layout.inputs.positional.all() else rmse(evidence, evidence.commands)
    repeats = measure_repeatability(evidence, floor)
    one_step = rmse(evidence, stepped)
    one_step_hold = rmse(evidence, recorded.positions)
    open_loop_hold = rmse(evidence, np.broadcast_to(evidence.initial_positions[:, None], predicted.shape))
    return {
        joint: JointGap(
            floor=float(floor[place]),
            one_step=float(one_step[place]),
            one_step_hold=float(one_step_hold[place]),
            open_loop=float(open_loop[place]),
            open_loop_hold=float(open_loop_hold[place]),
            open_loop_command=None if commands is None else float(commands[place]),
            ratio_to_noise=float(open_loop[place] / floor[place]),
            repeatability=None if repeats is None else float(repeats[place]),
            unit=find_joint_unit(joint, nominal.slides).si,
        )
        for place, joint in enumerate(evidence.joints)
    }


def rmse(evidence: EpisodeBatch, predicted: np.ndarray) -> np.ndarray:
    """Return the root mean squared error of each joint over all recorded rows [rad; m], shape (n,)."""
    return np.asarray(np.sqrt((evidence.errors(predicted) ** 2).sum((0, 1)) / evidence.mask.sum()))


def measure_repeatability(evidence: EpisodeBatch, floor: np.ndarray) -> np.ndarray | None:
    """Return the standard deviation between repeats of the same commands [rad; m], shape (n,); None without repeats."""
    squares, freedom = np.zeros(len(floor)), 0
    for group in find_repeats(evidence, floor):
        counts = evidence.mask[group[0]]
        measured = evidence.measured[group][:, counts]
        squares += ((measured - measured.mean(0)) ** 2).sum((0, 1))
        freedom += (len(group) - 1) * int(counts.sum())
    return np.sqrt(squares / freedom) if freedom else None


def find_repeats(evidence: EpisodeBatch, floor: np.ndarray) -> list[list[int]]:
    """Return groups of episodes with the same commands and initial pose."""
    groups: dict[bytes, list[int]] = defaultdict(list)
    for episode in range(len(evidence)):
        rows = evidence.commands[episode, evidence.mask[episode]]
        groups[rows.astype(np.float32).tobytes()].append(episode)
    found = []
    for group in groups.values():
        middle = np.median(evidence.initial_positions[group], axis=0)
        near = [
            episode
            for episode in group
            if (np.abs(evidence.initial_positions[episode] - middle) <= SAME_START * floor).all()
        ]
        if len(near) > 1:
            found.append(near)
    return found
