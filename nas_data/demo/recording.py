"""The demo's first stage: recordings of the target, paired with what the source predicts."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nas_data.dataset import versions
from nas_data.dataset.content import content_hash
from nas_data.dataset.provenance import Provenance
from nas_data.demo.plan import Plan
from nas_data.demo.stages import Demo, Found
from nas_data.excitations.babbling import Babbling
from nas_data.pairing import pair
from nas_data.recorders.environment import draw_environment_starts
from nas_data.recorders.readings import Readings
from nas_data.recorders.session import Protocol, Session, Target
from nas_data.recorders.simulated import to_dataset
from nas_data.robots.base import find_robot
from nas_data.sources import source_files

DATASETS = "datasets"
TRAIN, HELDOUT = "ergojr_demo", "ergojr_demo_heldout"


def record_pairs(demo: Demo) -> Found:
    """Record what the models learn from and what they are judged on, and pair both with the source."""
    plan = demo.plan
    train = record_and_pair(demo, TRAIN, plan.episodes, plan.seed)
    heldout = record_and_pair(demo, HELDOUT, plan.heldout, plan.seed + 1)
    moved = plan.episodes * plan.seconds
    said = [
        f"{plan.episodes} episodes to learn from ({train.frames:,} control steps, {moved:.0f} s of motion) "
        f"→ {demo.folder / train.path}",
        f"{plan.heldout} held-out episodes → {demo.folder / heldout.path}",
    ]
    return Found(said, {"train": train.describe(), "heldout": heldout.describe(), **gap(plan)})


@dataclass(frozen=True)
class Recorded:
    """A paired dataset of the demo: its folder below the demo's, its content hash, its size."""

    path: str
    content_hash: str
    episodes: int
    frames: int

    def describe(self) -> dict[str, object]:
        """Return it for JSON."""
        return vars(self)


def gap(plan: Plan) -> dict[str, object]:
    """Return what makes the target differ from the source, for people: the effects and the joints they sit in."""
    joints: dict[str, list[str]] = {}
    for effect in plan.task.effects(plan.dynamics):
        joints.setdefault(effect.name(), []).append(effect.joint or "the whole arm")
    return {"effects": [effect.to_json() for effect in plan.task.effects(plan.dynamics)], "joints": joints}


def record_and_pair(demo: Demo, name: str, episodes: int, seed: int) -> Recorded:
    """Record a dataset of the target, and pair it with the source as its next version."""
    plan, folder = demo.plan, demo.folder / DATASETS
    session = draw(plan, episodes, seed)
    recorded = to_dataset(session, play(session))
    before = provenance_of(session, plan)
    root = versions.new_version(recorded, name, before, folder)
    source = plan.task.simulator()
    paired = pair(recorded, source)
    provenance = replace(
        before,
        how="paired",
        source=source.describe(),
        parents=(versions.parent_of(root, recorded),),
    )
    files = {f"meta/{file}": content for file, content in source_files(find_robot(plan.task.robot)).items()}
    path = versions.new_version(paired, name, provenance, folder, files)
    return Recorded(str(path.relative_to(demo.folder)), content_hash(paired), paired.n_episodes, paired.n_frames)


def draw(plan: Plan, episodes: int, seed: int) -> Session:
    """Draw random targets in the task's own actions, held for longer or shorter times in different episodes.

    Joints that the task does not act on are commanded as in the task; first poses are the task's starts.
    """
    task, robot = plan.task, find_robot(plan.task.robot)
    readings = Readings(quantum=robot.position_quantum, velocity_quantum=robot.velocity_quantum)
    target = Target(robot, task.simulator(plan.dynamics), readings, rate=1 / task.period)
    every = [max(1, round(hold / task.period)) for hold in plan.holds]
    protocol = Protocol(
        excitation=Babbling(every=every[0]), episodes=episodes, seconds=plan.seconds, start="random", seed=seed
    )
    command_rng, pose_rng, noise_rng = np.random.default_rng(seed).spawn(3)
    width = task.action_space.shape[0]
    steps = round(plan.seconds / task.period)
    actions = [
        Babbling(every=every[episode % len(every)]).shape(command_rng, 1, steps, task.period, np.ones(width))[0]
        for episode in range(episodes)
    ]
    starts = draw_environment_starts(plan.environment, episodes, pose_rng)
    return Session(target, protocol, [task.command(rows) for rows in actions], starts, noise_rng)


def play(session: Session) -> list[np.ndarray]:
    """Play the session's commands from the task's own starts, where the play is in its middle.

    `recorders.simulated.record` lets the arm settle first; the policies' episodes begin without that.

    Returns:
        Readings of each episode before the first command and after each, shape (T + 1, 2n).
    """
    states = session.target.simulator.rollout(session.starts, np.stack(session.commands))
    return list(session.target.readings.of(np.concatenate([session.starts[:, None], states], axis=1), session.rng))


def provenance_of(session: Session, plan: Plan) -> Provenance:
    """Return where the recording comes from, with what differs from other recordings."""
    before = session.provenance()
    return replace(
        before,
        target={**(before.target or {}), "settled": 0.0},
        notes=f"Drawn as episodes of {plan.environment}: its starts, and targets for the joints that it acts on, held "
        f"for {', '.join(f'{hold:g}' for hold in plan.holds)} s in turn, episode by episode.",
    )


def newest(demo: Demo, name: str) -> Path:
    """Return the folder of a dataset's newest version: the paired one."""
    return versions.resolve(demo.folder / DATASETS / name)
