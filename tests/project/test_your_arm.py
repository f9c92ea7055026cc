"""The page "Your arm": its blocks run as they stand, on a dataset that LeRobot wrote."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.bag_samples import write_mcap
from support.lerobot_samples import RATE, SO101, from_ticks, write_calibration, write_lerobot
from support.urdf_samples import URDF

from nas_data.robots.base import find_robot
from nas_data.simulators.mujoco import MujocoSimulator

pytest.importorskip("lerobot")
PAGE = Path(__file__).parents[2] / "docs" / "your_arm.md"
BLOCK = re.compile(r"<!-- test(: slow)? -->\s*```bash\n(.*?)```", re.DOTALL)


def blocks(slow: bool) -> list[str]:
    """Return the blocks of the page that run; the slow ones only where asked for, in their places among the others."""
    return [text for mark, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")) if slow or not mark]


def write_recording(folder: Path) -> None:
    """Write `my_recording` and `my_arm.json`: a SO-101 that plays steps, read in ticks, kept in degrees by LeRobot."""
    rng, robot = np.random.default_rng(0), find_robot("so101_follower")
    arm = MujocoSimulator(robot, 1 / RATE, threads=1)
    start = np.concatenate([robot.rest, np.zeros(6)])
    commands = robot.rest + np.repeat(rng.uniform(-0.3, 0.3, (4, 3, 6)), 25, axis=1)
    states = arm.rollout(np.repeat(start[None], 4, axis=0), commands)[..., :6]
    states = np.concatenate([np.broadcast_to(start[:6], (4, 1, 6)), states[:, :-1]], axis=1)
    motors = write_calibration(folder / "my_arm.json", SO101)
    low, high = arm.model.joint("gripper").range

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


def write_others(folder: Path) -> None:
    """Write what the other sections read: a CSV log of four seconds, a bag, a URDF."""
    time = np.arange(200) / 50
    q, goal = (np.degrees(0.5 * np.sin(2 * (time[:, None] + ahead) * [1.0, 1.5])) for ahead in (0.0, 0.02))
    (folder / "logs").mkdir()
    table = np.column_stack([time, q, goal])
    np.savetxt(folder / "logs/a.csv", table, delimiter=",", header="time,q1,q2,goal1,goal2", comments="")
    write_mcap(folder / "take.mcap")
    (folder / "my_arm.urdf").write_text(URDF)


def run_page(folder: Path, slow: bool) -> None:
    """Run the blocks, one after the other, where a reader would."""
    write_recording(folder)
    write_others(folder)
    program = folder / "bin" / "nas"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m nas_data "$@"\n')
    program.chmod(0o755)
    search = {"PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(PAGE.parents[1])}
    for block in blocks(slow):
        shell = ["bash", "-euo", "pipefail", "-c", block]
        run = subprocess.run(shell, cwd=folder, env={**os.environ, **search}, capture_output=True, text=True)
        assert run.returncode == 0, f"a block failed:\n{block}\n{run.stdout}\n{run.stderr}"
        assert "contradicts" not in run.stdout + run.stderr


def test_the_blocks_of_the_page_run_one_after_the_other(tmp_path):
    run_page(tmp_path, slow=False)
    written = {path.name for path in (tmp_path / "datasets").iterdir()}
    assert written == {"so101", "my_arm", "my_arm_in_ros", "torques"}
    assert len(list((tmp_path / "datasets/torques").glob("v*"))) == 2  # recorded, paired


@pytest.mark.slow
def test_the_slow_blocks_of_the_page_run_among_the_others(tmp_path):
    run_page(tmp_path, slow=True)
    assert (tmp_path / "runs/gap/report.html").is_file()
    assert (tmp_path / "runs/export/parameters.csv").is_file()


def test_every_block_of_the_page_is_run():
    text = PAGE.read_text(encoding="utf-8")
    assert len(blocks(slow=True)) == text.count("```bash") > len(blocks(slow=False)) > 0
