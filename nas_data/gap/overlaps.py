"""Contacts of the model that the recording contradicts, because measured poses are inside its shapes.

Examples are a floor that is absent or lower, or collision shapes wider than the arm. They push joints away from
measured poses, which no effect of the catalogue does.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.dataset.dataset import Dataset
from nas_data.gap.nominal import Nominal
from nas_data.gap.poses import POSES, pose_arm
from nas_data.mjcf.free_bodies import find_free_bodies
from nas_data.mjcf.unique_name import make_unique_name
from nas_data.pairing import pair as pair_transitions

MIN_DEPTH = 0.001  # [m] smallest penetration; soft contacts at rest penetrate less
MIN_POSE_SHARE = 0.005  # smallest share of poses with such a penetration
MIN_ERROR_RATIO = 1.5  # smallest ratio of one-step errors with over without a contradicted contact

Pair = tuple[int, int]


@dataclass(frozen=True)
class Overlap:
    """Two bodies of the model that penetrate in measured poses.

    Attributes:
        depth: Largest penetration [m].
        share: Share of the measured poses with more than `MIN_DEPTH`.
        text: Names of the bodies.
    """

    depth: float
    share: float
    text: str


def find_overlaps(nominal: Nominal, dataset: Dataset) -> Mapping[Pair, Overlap]:
    """Return the pairs of bodies whose contact the recording contradicts, by body indices.

    If the arm does touch something, shapes penetrate slightly as well, but one-step errors are then lower with the
    contact than without it.

    Args:
        nominal: Model.
        dataset: Transitions.

    Returns:
        Overlaps; none with a body that a free joint moves.
    """
    rows = np.linspace(0, len(dataset.states) - 1, min(len(dataset.states), POSES)).astype(int)
    depths, names = find_depths(nominal, dataset.states[rows, : len(nominal.joints)])
    often = {pair: depth for pair, depth in depths.items() if (depth > 0).mean() > MIN_POSE_SHARE}
    if not often:
        return {}
    scales = np.sqrt(np.square(dataset.next_states - dataset.states).mean(0)) + np.finfo(float).eps
    errors = []
    for each in (nominal, exclude_contacts(nominal, often)):
        steps = pair_transitions(dataset, each.simulator()).sim_states - dataset.next_states
        errors.append(np.square((steps / scales)[rows, : len(nominal.joints)]).sum(1))
    return {
        pair: Overlap(float(depth.max()), float((depth > 0).mean()), names[pair])
        for pair, depth in often.items()
        if errors[0][depth > 0].mean() > MIN_ERROR_RATIO**2 * errors[1][depth > 0].mean()
    }


def find_depths(nominal: Nominal, poses: np.ndarray) -> tuple[dict[Pair, np.ndarray], dict[Pair, str]]:
    """Return penetrations of bodies in poses (N, n), shape (N,) [m], 0 below `MIN_DEPTH`; and their names."""
    simulator = nominal.simulator()
    model = simulator.model
    depths: dict[Pair, np.ndarray] = {}
    names: dict[Pair, str] = {}
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        return depths, names
    free = find_free_bodies(model)
    for row, data in enumerate(pose_arm(simulator, poses)):
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact:
            one, other = sorted(int(body) for body in model.geom_bodyid[contact.geom])
            if -contact.dist > MIN_DEPTH and not free[[one, other]].any():
                depth = depths.setdefault((one, other), np.zeros(len(poses)))
                depth[row] = max(depth[row], -contact.dist)
                names[one, other] = name_bodies(model, contact.geom)
    return depths, names


def exclude_contacts(nominal: Nominal, pairs: Collection[Pair]) -> Nominal:
    """Return the model with contacts between some pairs of bodies excluded."""
    if not pairs:
        return nominal

    def exclude(spec: mujoco.MjSpec) -> None:
        model = spec.compile()
        for pair in spec.pairs:
            bodies = sorted(int(model.geom(name).bodyid[0]) for name in (pair.geomname1, pair.geomname2))
            if tuple(bodies) in pairs:
                spec.delete(pair)
        for pair in sorted(pairs):
            for body in (spec.bodies[number] for number in pair):
                body.name = body.name or make_unique_name(spec.body, "body")
            spec.add_exclude(bodyname1=spec.bodies[pair[0]].name, bodyname2=spec.bodies[pair[1]].name)

    return nominal.with_edit(exclude)


def name_bodies(model: mujoco.MjModel, geoms: np.ndarray) -> str:
    """Return the names of two geoms' bodies; for the world, the geom's name."""
    words = []
    for geom in geoms:
        body = int(model.geom_bodyid[geom])
        words.append(model.body(body).name if body else model.geom(geom).name or "the world")
    return " and ".join(f"'{word}'" if word != "the world" else word for word in words)
