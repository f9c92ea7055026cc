"""What `nas policy evaluate --on ergojr` does: opens the ports, rolls out, keeps what was recorded, and tells of it."""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nas_data.commands.base import CommandResult
from nas_data.dataset.provenance import Provenance
from nas_data.envs.base import Task, find_task
from nas_data.errors import ArmError, OptionError
from nas_data.hardware.virtual_bus.ports import VIRTUAL, port_of
from nas_data.hardware.xl320.arm import Xl320
from nas_data.hardware.xl320.calibration import joints_of
from nas_data.hardware.xl320.configuration import Configuration
from nas_data.hardware.xl320.ergojr import ergojr_joints
from nas_data.hardware.xl320.joints import Joints
from nas_data.policies.evaluate import SEED, Returns
from nas_data.policies.policy import find_policies, load_policy
from nas_data.policies.rollouts.arm_setup import ArmSetup, make_path_planner
from nas_data.policies.rollouts.evaluation_plan import EvaluationPlan
from nas_data.policies.rollouts.recorded import Recorder, Saved, saved_as
from nas_data.policies.rollouts.robot_stepper import RobotStepper, RolloutTally
from nas_data.policies.rollouts.rollout import roll_out_on_arm
from nas_data.policies.tables import policy_table
from nas_data.recorders.guarded import Setup
from nas_data.recorders.schedule import MonotonicClock, SteppedClock
from nas_data.recorders.stopping import stop_on_signals
from nas_data.recorders.under_way import SAVING
from nas_data.runs.progress import say

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
    apart: str
    record: str | None
    speed: float
    largest_step: float
    lockstep: bool
    finish: bool

    def run(self) -> CommandResult:
        """Roll out every policy, as far as that is not yet saved; or make a dataset of what is."""
        if self.finish:
            return self._finish()
        environment = load_policy(find_policies(self.policies[0])[0]).environment
        programme = EvaluationPlan.of(self.policies, environment, self.episodes)
        with ExitStack() as stack:
            stack.enter_context(stop_on_signals())
            saved = stack.enter_context(saved_as(self.record)) if self.record else None
            task = find_task(environment)
            bench = self._bench(task, stack)
            bench.check(task)
            tally = saved.tally if saved else RolloutTally()
            tally.sittings += 1
            if saved:
                saved.resume(self._recorder(programme, environment, bench))
            with self._saying_what_is_saved(saved, programme), bench.open(task, tally) as on:
                scores = self._roll_out(programme, on, saved)
            path = saved.finish(_counted(tally)) if saved else None
        return self._outcome(programme, environment, scores, tally, path)

    def _roll_out(self, programme: EvaluationPlan, on: tuple[Task, RobotStepper], saved: Saved | None) -> list[Returns]:
        """Roll out what is not yet saved; return how all episodes went."""
        task, stepper = on
        scores, turns = list(saved.scores) if saved else [], programme.turns()
        progress = EvaluationProgress(len(scores), len(turns))
        for policy, seed in turns[len(scores) :]:
            bouts, judgement = roll_out_on_arm(task, stepper, policy, seed)
            if saved:
                stepper.extend_deadline(SAVING)
                saved.save(bouts, judgement)
            scores.append(judgement.score())
            progress(len(scores))
        return scores

    @contextmanager
    def _saying_what_is_saved(self, saved: Saved | None, programme: EvaluationPlan) -> Iterator[None]:
        """Say where it goes on, and where it will go on if this context ends early."""
        if saved is None:
            yield
            return
        wanted = len(programme.turns())
        if saved.scores:
            say(f"{len(saved.scores)} of {wanted} episodes are saved in {saved.growing.root}; going on with the next.")
        try:
            yield
        except (ArmError, OptionError) as error:
            raise type(error)(f"{error} {saved.describe_progress(wanted)}") from error
        except KeyboardInterrupt:
            say(saved.describe_progress(wanted))
            raise

    def _finish(self) -> CommandResult:
        """Make a dataset of what is saved."""
        assert self.record is not None
        with saved_as(self.record) as saved:
            path = saved.finish(_counted(saved.tally))
        returns = [float(score.returns[0]) for score in saved.scores]
        text = f"{len(returns)} episodes, mean return {np.mean(returns):.2f}.\n{_counted(saved.tally)}\n{path}"
        return CommandResult(text, {"dataset": path, "returns": returns, **_numbers(saved.tally)})

    def _bench(self, task: Task, stack: ExitStack) -> ArmSetup:
        """Open the ports; a virtual arm lives as long as the stack."""
        ports = [name for name in (self.port, self.defender_port) if name]
        if self.port == self.defender_port != VIRTUAL:
            raise OptionError(f"Both arms are said to be on {self.port}; each needs an adapter of its own.")
        setups = [self._setup(name, own, task, stack) for name, own in zip(ports, self.ids, strict=False)]
        clock = SteppedClock() if self.lockstep else MonotonicClock()
        defender = setups[1] if len(setups) > 1 else None
        return ArmSetup(
            attacker=setups[0],
            defender=defender,
            clock=clock,
            hits=self.hits,
            missed=self.missed,
            edges=self.apart == "all",
        )

    def _setup(self, name: str, own: str, task: Task, stack: ExitStack) -> Setup:
        return Setup(
            driver=Xl320(
                port=stack.enter_context(port_of(name, lockstep=self.lockstep and name == VIRTUAL)),
                joints=self._joints(name, own),
                configuration=self._configuration,
            ),
            planner=make_path_planner(),
            rate=1 / task.period,
            largest_step=self.largest_step,
        )

    @property
    def _configuration(self) -> Configuration:
        return Configuration(speed=self.speed)

    def _joints(self, port: str, own: str) -> Joints:
        return ergojr_joints() if port == VIRTUAL else joints_of(ergojr_joints(), "ergojr", own)

    def _recorder(self, programme: EvaluationPlan, environment: str, bench: ArmSetup) -> Recorder:
        """Return how rollouts are kept; what its provenance says decides whether a recording may be gone on with."""
        virtual = self.port == VIRTUAL
        provenance = Provenance(
            how="simulated" if virtual else "hardware",
            robot="ergojr",
            target={
                "kind": "virtual XL-320 servos" if virtual else "hardware",
                "arms": list(self.ids[: 2 if bench.defender else 1]),
                "hits": self.hits,
                "missed": self.missed,
                "apart": self.apart,
                "configuration": self._configuration.to_json(),
                "largest_step": self.largest_step,
            },
            signal={
                "policies": [str(path) for path in self.policies],
                "weights": programme.weights(),
                "environment": environment,
                "episodes": self.episodes,
            },
            seeds=(SEED,),
            contiguous=True,
        )
        return Recorder(
            joints=bench.attacker.driver.names,
            rate=bench.attacker.rate,
            task=environment,
            objects=find_task(environment).simulator().object_feature,
            provenance=provenance,
        )

    def _outcome(
        self, programme: EvaluationPlan, environment: str, scores: list[Returns], tally: RolloutTally, path: Path | None
    ) -> CommandResult:
        groups = programme.groups(scores)
        lines = [f"{environment} on {self.port}, {self.episodes} episodes a policy, mean actions:"]
        lines += [policy_table(groups, {}), self._told_by(), _counted(tally)]
        lines += [f"{len(scores)} episodes → {path}"] if path else []
        returns = [float(score.returns[0]) for score in scores]
        data = {
            "environment": environment,
            "port": self.port,
            "hits": self.hits if self.defender_port else None,
            "missed": self.missed,
            "episodes": self.episodes,
            "groups": [group.describe() for group in groups],
            "returns": [returns[first : first + self.episodes] for first in range(0, len(returns), self.episodes)],
            **_numbers(tally),
            "dataset": path,
        }
        return CommandResult("\n".join(lines), data)

    def _told_by(self) -> str:
        """Say what the rewards come from."""
        if not self.defender_port:
            return TOLD_BY
        if self.hits != "simulated":
            return f"Hits are what {self.hits} said."
        missed = f"; {self.missed:.1%} of them are missed" if self.missed else ""
        return f"Hits are told by where the model has sword and shield in the measured poses{missed}."


def _counted(tally: RolloutTally) -> str:
    """Say what happened, for people."""
    sittings = f" All in {tally.sittings} sittings." if tally.sittings > 1 else ""
    return (
        f"{tally.late} of {tally.steps} readings came late, {tally.missed} of them by more than a period; "
        f"{tally.held_back} commands would have led into a touch and were not sent; "
        f"{tally.retries} readings were tried again, {tally.unheard} times after a servo had gone unheard.{sittings}"
    )


def _numbers(tally: RolloutTally) -> dict[str, int]:
    """Return the same for JSON."""
    return {
        "sittings": tally.sittings,
        "steps": tally.steps,
        "late": tally.late,
        "missed_readings": tally.missed,
        "held_back": tally.held_back,
        "pauses": tally.pauses,
        "retries": tally.retries,
        "unheard": tally.unheard,
    }


class EvaluationProgress:
    """Says on stderr how many episodes are over, at most every two seconds."""

    def __init__(self, first: int, wanted: int) -> None:
        self._first, self._wanted = first, wanted
        self._began = self._spoken = time.monotonic()

    def __call__(self, done: int) -> None:
        """Report."""
        now = time.monotonic()
        if now - self._spoken < 2.0 and done < self._wanted:
            return
        self._spoken = now
        left = (now - self._began) / (done - self._first) * (self._wanted - done)
        say(f"{done} of {self._wanted} episodes, {left / 60:.0f} min left")
