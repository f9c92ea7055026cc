"""Excitation: constant commands, and joints that do not move."""

import numpy as np

from nas_data.count_of import join_items
from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.finding.audits.base import Examined
from nas_data.gap.finding.recorded import RESTING_FLOORS
from nas_data.gap.report_parts import Check

NAME = "excitation"
CONSTANT_TOLERANCE = 1e-6  # [rad or N·m] within which a command is constant


def check(examined: Examined) -> Check:
    """Name the joints without enough excitation."""
    evidence = examined.recorded.evidence
    steady, still = find_constant_commands(evidence), find_unmoved_joints(evidence, examined.floor)
    found = [(steady, "the command never changes"), (still & ~steady, "the joint never moves although commanded to")]
    said = [f"{join_chosen(evidence, chosen)}: {text}" for chosen, text in found if chosen.any()]
    if said:
        return Check(NAME, "; ".join(said) + ".", False)
    return Check(NAME, "Every joint is commanded to move, and moves.")


def join_chosen(evidence: EpisodeBatch, chosen: np.ndarray) -> str:
    """Return the names of chosen joints (n,)."""
    return join_items([joint for joint, is_chosen in zip(evidence.joints, chosen, strict=True) if is_chosen])


def find_constant_commands(evidence: EpisodeBatch) -> np.ndarray:
    """Return which joints have constant commands, shape (n,)."""
    return np.asarray(np.ptp(evidence.commands[evidence.mask], axis=0) <= CONSTANT_TOLERANCE)


def find_unmoved_joints(evidence: EpisodeBatch, floor: np.ndarray) -> np.ndarray:
    """Return which joints do not move in any episode, shape (n,)."""
    span = np.ptp(np.concatenate([evidence.initial_positions[:, None], evidence.measured], axis=1), axis=1)
    return np.asarray(span.max(axis=0) <= RESTING_FLOORS * floor)
