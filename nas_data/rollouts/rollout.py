"""Policies on an ErgoJr, or on two of them: the arms taken over, episodes rolled out, scores as in simulation."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from nas_data.envs.base import Task
from nas_data.envs.ergo_shield import ErgoShield, touches
from nas_data.errors import OptionError
from nas_data.policies.evaluate import SEED, Group, Score, check_fits, roll_out
from nas_data.policies.policy import Policy, find_policies, load_policy
from nas_data.recorders.ergojr_ways import Ways
from nas_data.recorders.guarded import GuardedArm, Setup
from nas_data.recorders.schedule import Clock
from nas_data.robots.base import find_robot
from nas_data.robots.ergojr import JOINTS
from nas_data.rollouts.keyboard import Keyboard
from nas_data.rollouts.robot_stepper import AHEAD, Bout, RobotStepper
from nas_data.simulators.base import Stepper

ARM = "ergojr_penholder"  # model of either arm by itself
NO_LOAD_SPEED = 11.9  # [rad/s] at 7.4 V, XL-320 e-manual (114 rpm)
SIMULATED = "simulated"


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What stands on the table.

    Attributes:
        attacker: The arm that is commanded.
        defender: The other one, where the task has one.
        clock: By which they are moved.
        hits: Where hits are read: an input device, or `simulated` for the geometry of the measured poses.
        missed: Share of the simulated hits that are not noticed.
    """

    attacker: Setup
    defender: Setup | None
    clock: Clock
    hits: str = SIMULATED
    missed: float = 0.0

    def check(self, task: Task) -> None:
        """Find out whether a task can be done on what is there.

        Raises:
            OptionError: says what is missing, or too much.
        """
        if task.joints != JOINTS:
            raise OptionError(f"An ErgoJr cannot do the task of a {task.robot}; roll out ErgoReacher or ErgoShield.")
        if isinstance(task, ErgoShield) != (self.defender is not None):
            what = "needs a second arm: give --defender-port" if self.defender is None else "takes no --defender-port"
            raise OptionError(f"{type(task).__name__} {what}.")
        if not 0 <= self.missed <= 1 or (self.missed and (self.hits != SIMULATED or self.defender is None)):
            raise OptionError(f"--missed {self.missed} is a share (0 … 1) of simulated hits in ErgoShield.")

    @contextmanager
    def open(self, task: Task, ended: Callable[[Bout], None]) -> Iterator[tuple[Task, RobotStepper]]:
        """Take the arms over; yield the task as it is told here, and what moves.

        Args:
            task: What is to be done.
            ended: Told what was read and sent, from reset to reset.

        Raises:
            ArmError: something is wrong with an arm; all of them are without torque then.
            OptionError: the device of the hits cannot be read.
        """
        self.check(task)
        rest = np.zeros(len(JOINTS))
        with ExitStack() as stack:
            noticed = self._noticed(task, stack)
            arms = [stack.enter_context(GuardedArm(self.attacker, self.clock))]
            if self.defender:
                arms.append(stack.enter_context(GuardedArm(self.defender, self.clock)))
                arms[0].accompany(arms[1])
            motions = [arm.take(rest) for arm in arms]
            stepper = RobotStepper(
                motions[0],
                motions[1] if self.defender else None,
                task.simulator(),
                self.attacker.ways,
                AHEAD * (self.attacker.configuration.speed or NO_LOAD_SPEED),
                ended,
            )
            yield noticed, stepper
            stepper.end()

    def _noticed(self, task: Task, stack: ExitStack) -> Task:
        """Return a task that reads its hits where they come from."""
        if not isinstance(task, ErgoShield):
            return task
        touched: Callable[[Stepper], np.ndarray] = touches
        if self.hits != SIMULATED:
            touched = stack.enter_context(Keyboard(self.hits))
        return replace(task, touched=touched, missed=self.missed)


def ways() -> Ways:
    """Return the slow ways of an arm with a pen holder."""
    return Ways(find_robot(ARM))


def judge(
    paths: Sequence[Path],
    environment: str,
    on: tuple[Task, RobotStepper],
    episodes: int,
    progress: Callable[[int, int], None],
) -> list[Group]:
    """Roll out policies, one episode after the other, each from the start that it has in simulation.

    Args:
        paths: Folders of policies.
        environment: What they are judged on.
        on: The task and what moves.
        episodes: Of each policy.
        progress: Told how many episodes are over, of how many.
    """
    found = [(path, find_policies(path)) for path in paths]
    policies = {folder: load_policy(folder) for _, folders in found for folder in folders}
    for policy in policies.values():
        check_fits(policy, environment)
    wanted, done = len(policies) * episodes, 0
    groups = []
    for path, folders in found:
        scores = []
        for folder in folders:
            single = []
            for number in range(episodes):
                single.append(_once(policies[folder], on, SEED + number))
                done += 1
                progress(done, wanted)
            scores.append(together(single))
        groups.append(Group(str(path), folders, [policies[folder] for folder in folders], scores))
    return groups


def _once(policy: Policy, on: tuple[Task, RobotStepper], seed: int) -> Score:
    task, stepper = on
    return roll_out(task, stepper, lambda _: policy.act, seed)


def together(scores: Sequence[Score]) -> Score:
    """Return episodes that went one after the other as one score."""
    return Score(
        **{field.name: np.concatenate([getattr(score, field.name) for score in scores]) for field in fields(Score)}
    )
