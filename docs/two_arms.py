"""Roll a policy for ErgoShield out on two virtual arms and count in how many readings the arms' bodies overlap.

    nas policy train --env ErgoShield --on source --frames 400000 --seed 0 --out runs/shield
    python docs/two_arms.py runs/shield 2 unchecked bodies all

`unchecked` sends every command and goes every slow way straight; the others are what `--apart` may be. Starts are those
of the first episodes in simulation; in lock-step the same policy gives the same figures.
"""

import contextlib
import io
import json
import sys
from collections.abc import Iterator
from typing import Literal
from unittest.mock import patch

import numpy as np
import tyro

from nas_data.cli import main as nas
from nas_data.policies.rollouts.robot_stepper import RobotStepper
from nas_data.policies.rollouts.two_arm_planner import Approach, TwoArmPlanner, make_two_arm_planner
from nas_data.recorders.path_planner import PathPlanner
from nas_data.robots.ergo_shield import DEFENDER
from nas_data.simulators.contact import find_contacts

LOCKSTEP = ("--on", "ergojr", "--port", "virtual", "--defender-port", "virtual", "--lockstep", "--json")
Poses = list[np.ndarray]


@contextlib.contextmanager
def watched() -> Iterator[tuple[Poses, Poses]]:
    """Yield where the poses of both arms [rad], shape (12,), gather: those of steps, and those of slow ways."""
    steps, slow, read, approach = Poses(), Poses(), RobotStepper._read, Approach._read

    def reading(stepper: RobotStepper, unheard: int) -> None:
        read(stepper, unheard)
        steps.append(stepper._measured()[0])

    def approaching(arms: Approach) -> tuple[np.ndarray, np.ndarray]:
        found = approach(arms)
        slow.append(found[0])
        return found

    with patch.object(RobotStepper, "_read", reading), patch.object(Approach, "_read", approaching):
        yield steps, slow


@contextlib.contextmanager
def unchecked() -> Iterator[None]:
    """Let nothing be looked at before it is done: the attacker goes straight to its pose, then the defender."""

    def straight(_: TwoArmPlanner, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        return np.stack([np.concatenate([end[:6], begin[6:]]), end])

    with patch.object(PathPlanner, "enters_contact", lambda *_: False), patch.object(TwoArmPlanner, "find", straight):
        yield


def depths(planner: PathPlanner, poses: Poses) -> np.ndarray:
    """Return how deep [m] attacker and defender are in one another, zero where they are not, shape (N,)."""
    found = [find_contacts(planner._simulator, pose, planner._scratch) for pose in poses]
    between = [[-far for pair, far in each.items() if sum(DEFENDER in name for name in pair) == 1] for each in found]
    return np.array([max(each, default=0.0) for each in between])


def told(planner: PathPlanner, poses: Poses) -> str:
    """Say how many readings overlap, and how deep."""
    deep = depths(planner, poses)
    return f"{np.count_nonzero(deep)} of {len(deep)} (up to {1e3 * deep.max(initial=0.0):.1f} mm)"


def measure(policy: str, episodes: str, kind: str) -> None:
    """Roll out, and print a line."""
    options = (policy, "--episodes", episodes, *LOCKSTEP, *(("--apart", "all") if kind == "all" else ()))
    said = io.StringIO()
    care = unchecked() if kind == "unchecked" else contextlib.nullcontext()
    with care, watched() as (steps, slow), contextlib.redirect_stdout(said):
        code = nas(["policy", "evaluate", *options])
    if code:
        sys.exit(said.getvalue())
    answer, bodies, edges = json.loads(said.getvalue()), make_two_arm_planner(), make_two_arm_planner(edges=True)
    print(f"{kind}: touches {answer['returns'][0]}, {answer['held_back']} commands held back")
    print(f"  bodies: {told(bodies, steps)} in episodes, {told(bodies, slow)} on slow ways")
    print(f"  bodies, sword and shield: {told(edges, steps)} in episodes, {told(edges, slow)} on slow ways", flush=True)


def main(
    policy: tyro.conf.Positional[str],
    episodes: tyro.conf.Positional[str],
    kinds: tyro.conf.Positional[tuple[Literal["unchecked", "bodies", "all"], ...]],
) -> None:
    """Roll the policy out in each of the ways, and print what touched.

    Args:
        policy: Folder of a policy for ErgoShield.
        episodes: How many episodes to roll out in each way.
        kinds: Means of keeping the arms apart, one after the other.
    """
    for kind in kinds:
        measure(policy, episodes, kind)


if __name__ == "__main__":
    tyro.cli(main)
