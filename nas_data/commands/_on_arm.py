"""What `nas policy evaluate --on ergojr` does: opens the ports, rolls out, keeps what was recorded, and tells of it."""

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from nas_data.commands.base import Outcome
from nas_data.dataset.provenance import Provenance
from nas_data.envs.base import Task, find_task
from nas_data.errors import ArmError, OptionError
from nas_data.policies.evaluate import SEED, Group
from nas_data.policies.policy import find_policies, load_policy
from nas_data.policies.tables import policy_table
from nas_data.recorders.guarded import Setup
from nas_data.recorders.schedule import MonotonicClock, SteppedClock
from nas_data.recorders.stopping import stoppable
from nas_data.rollouts.recorded import Recorder, Saved
from nas_data.rollouts.robot_stepper import Bout, RobotStepper
from nas_data.rollouts.rollout import Bench, judge, ways
from nas_data.virtual_bus.ports import VIRTUAL, port_of
from nas_data.xl320.calibration import joints_of
from nas_data.xl320.configuration import Configuration
from nas_data.xl320.ergojr import ergojr_joints
from nas_data.xl320.joints import Joints

TOLD_BY = (
    "The tip whose distance to the goal counts is where the model has it in the measured pose (forward kinematics)."
)


@dataclass(frozen=True, kw_only=True)
class OnArm:
    """The command's options for an arm; see `PolicyEvaluate`."""

    policies: tuple[Path, ...]
    episodes: int
    port: str
    defender_port: str | None
    ids: tuple[str, str]
    hits: str
    missed: float
    record: str | None
    speed: float
    largest_step: float
    lockstep: bool

    def run(self) -> Outcome:
        """Roll out every policy."""
        environment = load_policy(find_policies(self.policies[0])[0]).environment
        task, saved = find_task(environment), Saved()
        with ExitStack() as stack:
            stack.enter_context(stoppable())
            bench = self._bench(task, stack)
            bench.check(task)
            ended: Callable[[Bout], None] = lambda _: None  # noqa: E731  # what takes bouts where none are kept
            if self.record:
                ended, saved = stack.enter_context(self._recorder(self.record, environment, bench).recording())
            try:
                with bench.open(task, ended) as on:
                    groups = judge(self.policies, environment, on, self.episodes, Progress())
            except ArmError as error:
                kept = f" {saved.episodes} bouts are kept as datasets/{self.record}." if saved.episodes else ""
                raise type(error)(f"{error}{kept}") from error
        return self._outcome(environment, groups, on[1], saved)

    def _bench(self, task: Task, stack: ExitStack) -> Bench:
        """Open the ports; a virtual arm lives as long as the stack."""
        ports = [name for name in (self.port, self.defender_port) if name]
        if self.port == self.defender_port != VIRTUAL:
            raise OptionError(f"Both arms are said to be on {self.port}; each needs an adapter of its own.")
        setups = [self._setup(name, own, task, stack) for name, own in zip(ports, self.ids, strict=False)]
        clock = SteppedClock() if self.lockstep else MonotonicClock()
        defender = setups[1] if len(setups) > 1 else None
        return Bench(attacker=setups[0], defender=defender, clock=clock, hits=self.hits, missed=self.missed)

    def _setup(self, name: str, own: str, task: Task, stack: ExitStack) -> Setup:
        return Setup(
            port=stack.enter_context(port_of(name, lockstep=self.lockstep and name == VIRTUAL)),
            joints=self._joints(name, own),
            ways=ways(),
            rate=1 / task.period,
            configuration=Configuration(speed=self.speed),
            largest_step=self.largest_step,
        )

    def _joints(self, port: str, own: str) -> Joints:
        return ergojr_joints() if port == VIRTUAL else joints_of(ergojr_joints(), "ergojr", own)

    def _recorder(self, name: str, environment: str, bench: Bench) -> Recorder:
        """Return what keeps the bouts."""
        task, virtual = find_task(environment), self.port == VIRTUAL
        target = {"kind": "virtual XL-320 servos" if virtual else "hardware", "hits": self.hits, "missed": self.missed}
        provenance = Provenance(
            how="simulated" if virtual else "hardware",
            robot="ergojr",
            target={**target, "configuration": bench.attacker.configuration.to_json()},
            signal={"policies": [str(path) for path in self.policies], "environment": environment},
            seeds=(SEED,),
            contiguous=True,
        )
        return Recorder(
            name=name,
            joints=bench.attacker.joints,
            rate=bench.attacker.rate,
            task=environment,
            objects=task.simulator().object_feature,
            provenance=provenance,
        )

    def _outcome(self, environment: str, groups: list[Group], stepper: RobotStepper, saved: Saved) -> Outcome:
        lines = [f"{environment} on {self.port}, {self.episodes} episodes a policy, mean actions:"]
        lines += [policy_table(groups, {}), self._told_by()]
        lines.append(
            f"{stepper.late} of {stepper.steps} readings came late, {stepper.missed} of them by more than a period; "
            f"{stepper.held_back} commands would have led into a "
            "touch and were not sent."
        )
        lines += [f"{saved.episodes} bouts → {saved.path}"] if saved.path else []
        data = {
            "environment": environment,
            "port": self.port,
            "hits": self.hits if self.defender_port else None,
            "missed": self.missed,
            "episodes": self.episodes,
            "groups": [group.describe() for group in groups],
            "steps": stepper.steps,
            "late": stepper.late,
            "missed_readings": stepper.missed,
            "held_back": stepper.held_back,
            "dataset": saved.path,
        }
        return Outcome("\n".join(lines), data)

    def _told_by(self) -> str:
        """Say what the rewards come from."""
        if not self.defender_port:
            return TOLD_BY
        if self.hits != "simulated":
            return f"Hits are what {self.hits} said."
        missed = f"; {self.missed:.1%} of them are missed" if self.missed else ""
        return f"Hits are told by where the model has sword and shield in the measured poses{missed}."


class Progress:
    """Says on stderr how many episodes are over, at most every two seconds."""

    def __init__(self) -> None:
        self._began = self._spoken = time.monotonic()

    def __call__(self, done: int, wanted: int) -> None:
        """Report."""
        now = time.monotonic()
        if now - self._spoken < 2.0 and done < wanted:
            return
        self._spoken = now
        left = (now - self._began) / done * (wanted - done)
        print(f"{done} of {wanted} episodes, {left / 60:.0f} min left", file=sys.stderr, flush=True)
