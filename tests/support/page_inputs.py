"""What the blocks of the documentation read: recordings, models and policies that a reader has at hand."""

from pathlib import Path

import numpy as np
from support.bag_samples import write_mcap
from support.experiment_samples import TINY
from support.lerobot_samples import RATE, SO101, from_ticks, write_calibration, write_lerobot
from support.report_samples import gap_report
from support.urdf_samples import URDF

import nas_data as nas
from nas_data.cli import main
from nas_data.dataset.read import read
from nas_data.effects.base import parse
from nas_data.gap import workflow
from nas_data.gap.report import GapReport
from nas_data.gap.write_model import write_effects
from nas_data.robots.base import find_robot
from nas_data.runs.progress import Report
from nas_data.simulators.mujoco import MujocoSimulator
from nas_data.studies.experiments.pipeline import sizes


def move_so101(episodes: int, moves: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and commands [rad] of a simulated SO-101 that plays steps, (episodes, 25 · moves, 6) each."""
    rng, robot = np.random.default_rng(0), find_robot("so101_follower")
    arm = MujocoSimulator(robot, 1 / RATE, threads=1)
    start = np.concatenate([robot.rest, np.zeros(6)])
    commands = robot.rest + np.repeat(rng.uniform(-0.3, 0.3, (episodes, moves, 6)), 25, axis=1)
    states = arm.rollout(np.repeat(start[None], episodes, axis=0), commands)[..., :6]
    return np.concatenate([np.broadcast_to(start[:6], (episodes, 1, 6)), states[:, :-1]], axis=1), commands


def write_recording(folder: Path, moves: int = 3) -> None:
    """Write `my_recording` and `my_arm.json`: an SO-101 read in ticks, kept in degrees by LeRobot."""
    states, commands = move_so101(4, moves)
    motors = write_calibration(folder / "my_arm.json", SO101)
    low, high = MujocoSimulator(find_robot("so101_follower"), 1 / RATE, threads=1).model.joint("gripper").range

    def stored(angles: np.ndarray) -> np.ndarray:
        found = []
        for joint, motor, angle in zip(SO101, motors.values(), angles.T, strict=True):
            first, last = motor["range_min"], motor["range_max"]
            grips = joint == "gripper"
            share = (angle - low) / (high - low) if grips else 0.5 + angle * 4095 / (2 * np.pi) / (last - first)
            found.append(from_ticks(np.round(first + share * (last - first)), motor, "percent" if grips else "deg"))
        return np.array(found).T

    episodes = [(stored(state), stored(command)) for state, command in zip(states, commands, strict=True)]
    write_lerobot(folder / "my_recording", episodes, SO101, "so101_follower")


def write_long_recording(folder: Path) -> None:
    """Write `my_recording` with episodes of 7 s."""
    write_recording(folder, moves=14)


def write_logs(folder: Path) -> None:
    """Write a CSV log of four seconds, a bag and a URDF, beside `my_recording`."""
    write_recording(folder)
    time = np.arange(200) / 50
    q, goal = (np.degrees(0.5 * np.sin(2 * (time[:, None] + ahead) * [1.0, 1.5])) for ahead in (0.0, 0.02))
    (folder / "logs").mkdir()
    table = np.column_stack([time, q, goal])
    np.savetxt(folder / "logs/a.csv", table, delimiter=",", header="time,q1,q2,goal1,goal2", comments="")
    write_mcap(folder / "take.mcap")
    (folder / "my_arm.urdf").write_text(URDF)


def write_so101_logs(folder: Path) -> None:
    """Write logs as SAGE publishes them, and the model of the arm."""
    (folder / "so101_new_calib.xml").write_bytes(find_robot("so101_follower").mjcf.read_bytes())
    low, high = -0.17453297762778586, 1.7453291995659765  # [rad] of the gripper, as in the map so101_npz
    for number, (position, action) in enumerate(zip(*move_so101(8), strict=True)):
        place = folder / ("recordings" if number < 6 else "held_out")
        place.mkdir(exist_ok=True)
        for angles in (position, action):
            angles[:, -1] = (angles[:, -1] - low) / (high - low)
        still = np.zeros_like(position)
        time = np.arange(len(position)) / 49.85
        np.savez(
            place / f"motion{number}.npz",
            t=time,
            position=position,
            velocity=still,
            action=action,
            current_torque=still,
            joint_names=np.array(SO101),
        )


def record_so101(folder: Path) -> None:
    """Record `datasets/so101`, and write a model that follows it less stiffly."""
    model = find_robot("so101_follower").mjcf
    nas.record("so101_follower", episodes=4, seconds=1).save(folder / "datasets/so101")
    (folder / "runs/gap").mkdir(parents=True)
    (folder / "runs/gap/model.xml").write_text(model.read_text())


def record_pendulum(folder: Path) -> None:
    """Record `datasets/arm`, a pendulum with play, and write its model without."""
    nas.record("pendulum", effects=["backlash:joint=pendulum,half_width=0.08"], episodes=13, seconds=2).save(
        folder / "datasets/arm"
    )
    (folder / "arm.xml").write_bytes(find_robot("pendulum").mjcf.read_bytes())


def train_policies(folder: Path) -> None:
    """Train the two policies that the page of the arm lets act, briefly."""
    for name, env in (("ErgoReacher-named", "ErgoReacher"), ("ErgoShield-source", "ErgoShield")):
        out = str(folder / "runs/policy" / name)
        assert main(["policy", "train", "--env", env, "--on", "source", "--frames", "1", "--out", out]) == 0


def shrink_experiments() -> None:
    """Make the paper's experiments tiny, and let `nas gap`, which takes minutes, name play in the first joint."""

    def investigate(dataset: Path, model: Path, out: Path, say: Report) -> GapReport:
        out.mkdir(parents=True, exist_ok=True)
        write_effects(out, [parse(f"backlash:joint={read(dataset).joints[0]},half_width=0.01")], {})
        return gap_report(verdict="partly_explained")

    workflow.investigate = investigate
    sizes.FULL = sizes.QUICK = TINY
