"""What `nas record sim` and `nas pair` do, from nothing to a version on disk, as benchmarks time it."""

from collections.abc import Sequence
from pathlib import Path

from nas_data.api.pairing import make_pairs
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.origin import describe
from nas_data.dataset.versions import save
from nas_data.effects.base import parse
from nas_data.environment_ids import environment_id
from nas_data.envs.base import find_task, find_task_file
from nas_data.excitations.steps import Steps
from nas_data.recorders.readings import Readings
from nas_data.recorders.session import PlaybackProtocol, RecordingSession, Target
from nas_data.recorders.simulated import record, to_dataset
from nas_data.robots.base import find_robot
from nas_data.simulators.engines import load_simulator


def robot_target(name: str, rate: float, effects: Sequence[str] = (), exact: bool = True) -> Target:
    """Return a robot with effects, at a control rate [Hz]; exact readings, or those of its sensors."""
    robot = find_robot(name)
    own = Readings(quantum=robot.position_quantum, velocity_quantum=robot.velocity_quantum)
    simulator = load_simulator(robot, 1 / rate, effects=tuple(map(parse, effects)))
    return Target(robot, simulator, Readings() if exact else own, rate)


def record_robot(target: Target, out: Path, episodes: int, seconds: float) -> Path:
    """Record episodes of steps, each so many seconds long; return the folder."""
    return record_protocol(target, PlaybackProtocol(excitation=Steps(), episodes=episodes, seconds=seconds), out)


def record_environment(name: str, dynamics: str, out: Path, episodes: int) -> Path:
    """Record whole episodes of an environment's target, with exact readings; return the folder."""
    task = find_task(name)
    robot, effects = task.body(dynamics)
    target = Target(robot, load_simulator(robot, task.period, task.joints, effects), Readings(), 1 / task.period)
    identity = environment_id(find_task_file(name))
    seconds = task.horizon * task.period
    protocol = PlaybackProtocol(excitation=Steps(), episodes=episodes, seconds=seconds, environment=identity)
    return record_protocol(target, protocol, out)


def record_protocol(target: Target, protocol: PlaybackProtocol, out: Path) -> Path:
    """Play a protocol on a target and write what it measures; return the folder."""
    session = RecordingSession.draw(target, protocol)
    return save(to_dataset(session, record(session)), session.provenance(), out=out)


def pair_folder(root: Path, model: str, out: Path) -> Path:
    """Pair a recorded dataset with a robot as source; return the folder."""
    paired = make_pairs(Dataset.load(root), model).dataset
    provenance, kept = describe(paired)
    return save(paired, provenance, out=out, parent=root, attachments=kept)
