"""Contacts of the model that the recording contradicts: the measured arm goes through what the model would touch.

A floor that is not there, or higher than the arm's, or shapes that are wider than the arm's, push the model's joints
away from poses that were measured. No effect of the catalogue does that, and every one is bent to it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from nas_data.gap.episode_batch import EpisodeBatch
from nas_data.gap.nominal import Nominal
from nas_data.mjcf.unique_name import free_name

DEEP = 0.005  # [m] by which shapes overlap; a soft contact yields by less
OFTEN = 0.005  # of the poses, in which they overlap so far; one odd reading decides nothing
POSES = 2_000  # measured poses that are looked at, evenly

Pair = tuple[int, int]


@dataclass(frozen=True)
class Overlap:
    """Two bodies of the model that lie in each other where the arm was measured.

    Attributes:
        depth: How deep, at most [m].
        share: In which part of the measured poses deeper than `DEEP`.
        text: The bodies, as a person is told of them.
    """

    depth: float
    share: float
    text: str


def find_overlaps(nominal: Nominal, evidence: EpisodeBatch) -> Mapping[Pair, Overlap]:
    """Return which bodies of a model overlap in measured poses, by their numbers; none with an object's."""
    simulator = nominal.simulator()
    model, data = simulator.model, mujoco.MjData(simulator.model)
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        return {}
    poses = evidence.measured[evidence.counts]
    poses = poses[np.linspace(0, len(poses) - 1, min(len(poses), POSES)).astype(int)]
    depths: dict[Pair, list[float]] = {}
    names: dict[Pair, str] = {}
    free = free_bodies(model)
    layout = simulator.layout
    for pose in poses:
        data.qpos[layout.qpos] = pose
        if layout.followers is not None:
            layout.followers.place(data.qpos[None], data.qvel[None])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        deepest: dict[Pair, float] = {}
        for contact in data.contact:
            one, other = sorted(int(body) for body in model.geom_bodyid[contact.geom])
            if not free[[one, other]].any() and -contact.dist > deepest.get((one, other), DEEP):
                deepest[one, other] = -float(contact.dist)
                names[one, other] = describe(model, contact.geom)
        for pair, depth in deepest.items():
            depths.setdefault(pair, []).append(depth)
    found = {pair: Overlap(max(each), len(each) / len(poses), names[pair]) for pair, each in depths.items()}
    return {pair: overlap for pair, overlap in found.items() if overlap.share > OFTEN}


def without_overlaps(nominal: Nominal, evidence: EpisodeBatch) -> Nominal:
    """Return the model without the contacts of bodies that overlap in measured poses."""
    pairs = set(find_overlaps(nominal, evidence))
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
                body.name = body.name or free_name(spec.body, "body")
            spec.add_exclude(bodyname1=spec.bodies[pair[0]].name, bodyname2=spec.bodies[pair[1]].name)

    return nominal.changed(exclude)


def free_bodies(model: mujoco.MjModel) -> np.ndarray:
    """Return which bodies are moved by a free or a ball joint: objects, posed by no joint of the arm, shape (B,)."""
    kinds = (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)
    free = np.zeros(model.nbody, bool)
    free[model.jnt_bodyid[np.isin(model.jnt_type, [int(kind) for kind in kinds])]] = True
    for body in range(1, model.nbody):  # parents stand before their children
        free[body] |= free[model.body_parentid[body]]
    return free


def describe(model: mujoco.MjModel, geoms: np.ndarray) -> str:
    """Return the names of two geoms' bodies; of what stands in the world the geom's own."""
    words = []
    for geom in geoms:
        body = int(model.geom_bodyid[geom])
        words.append(model.body(body).name if body else model.geom(geom).name or "the world")
    return " and ".join(f"'{word}'" if word != "the world" else word for word in words)
