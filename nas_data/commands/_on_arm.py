"""Evaluation of policies on an arm, for `nas policy evaluate --on ergojr`: rollouts, their recording, the result."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nas_data.commands.base import CommandResult
from nas_data.count_of import count_of
from nas_data.dataset.provenance import Provenance
from nas_data.envs.base import Task, find_task
from nas_data.errors import ArmError, OptionError
from nas_data.hardware.virtual_bus.process import VIRTUAL, port_of
from nas_data.hardware.xl320.arm import Configuration, Xl320
from nas_data.hardware.xl320.joints import Joints, find_joints, make_ergojr_joints
from nas_data.policies.evaluate import SEED, Returns, format_policy_table, warn_of_unequal_training
from nas_data.policies.policy import find_policies, load_policy
from nas_data.policies.rollouts.arm_setup import SIMULATED, ArmSetup, make_path_planner
from nas_data.policies.rollouts.recorded import Recorder, Saved, saved_as
from nas_data.policies.rollouts.robot_stepper import RobotStepper, RolloutTally
from nas_data.policies.rollouts.rollout import EvaluationPlan, roll_out_on_arm
from nas_data.recorders.guarded import Setup
from nas_data.recorders.recording_folder import SAVING
from nas_data.recorders.schedule import MonotonicClock, SteppedClock
from nas_data.recorders.stopping import stop_on_signals
from nas_data.runs.progress import Counting, say

if TYPE_CHECKING:
    from nas_data.commands.policy_evaluate import PolicyEvaluate

FORWARD_KINEMATICS = (
    "The tip position in the reward is computed from the measured pose (forward kinematics of the model)."
)


@dataclass(frozen=True)
class OnArm:
    """Evaluation of policies on an arm."""

    options: "PolicyEvaluate"  # the command with its options
    port: str  # port of the arm's adapter

    @property
    def ids(self) -> tuple[str, str]:
        """Names of both arms."""
        return self.options.id, self.options.defender_id

    @property
    def hits(self) -> str:
        """Source of hits."""
        return self.options.hits or SIMULATED

    def run(self) -> CommandResult:
        """Roll out every policy, except for saved episodes; with --finish, only write the dataset."""
        if self.options.finish:
            return self._finish()
        environment = load_policy(find_policies(self.options.policies[0])[0]).environment
        plan = EvaluationPlan.of(self.options.policies, environment, self.options.episodes)
        with ExitStack() as stack:
            stack.enter_context(stop_on_signals())
            saved = stack.enter_context(saved_as(self.options.record)) if self.options.record else None
            task = find_task(environment)
            arms = self._arms(task, stack)
            arms.check(task)
            tally = saved.tally if saved else RolloutTally()
            tally.sittings += 1
            if saved:
                saved.resume(self._recorder(plan, environment, arms))
            with self._report_saved(saved, plan), arms.open(task, tally) as on:
                scores = self._roll_out(plan, on, saved)
            path = saved.finish(describe_tally(tally)) if saved else None
        return self._make_result(plan, environment, scores, tally, path)

    def _roll_out(self, plan: EvaluationPlan, on: tuple[Task, RobotStepper], saved: Saved | None) -> list[Returns]:
        """Roll out the episodes that are not saved yet; return the scores of all episodes."""
        task, stepper = on
        scores, turns = list(saved.scores) if saved else [], plan.turns()
        count = Counting("rolled out")
        for policy, seed in turns[len(scores) :]:
            count(len(scores), len(turns))
            attempts, score = roll_out_on_arm(task, stepper, policy, seed)
            if saved:
                stepper.extend_deadline(SAVING)
                saved.save(attempts, score)
            scores.append(score.to_returns())
        return scores

    @contextmanager
    def _report_saved(self, saved: Saved | None, plan: EvaluationPlan) -> Iterator[None]:
        """Report the saved episodes at the beginning, and at the end if the context is left by an error."""
        if saved is None:
            yield
            return
        wanted = len(plan.turns())
        if saved.scores:
            say(
                f"{len(saved.scores)} of {count_of(wanted, 'episode')} are saved in {saved.growing.root}; continuing "
                "with the next."
            )
        try:
            yield
        except (ArmError, OptionError) as error:
            raise type(error)(f"{error} {saved.describe_progress(wanted)}") from error
        except KeyboardInterrupt:
            say(saved.describe_progress(wanted))
            raise

    def _finish(self) -> CommandResult:
        """Write the dataset of the saved episodes."""
        assert self.options.record is not None
        with saved_as(self.options.record) as saved:
            path = saved.finish(describe_tally(saved.tally))
        returns = [float(score.returns[0]) for score in saved.scores]
        text = (
            f"{count_of(len(returns), 'episode')}, mean return "
            f"{np.mean(returns):.2f}.\n{describe_tally(saved.tally)}\n{path}"
        )
        return CommandResult(text, {"dataset": path, "returns": returns, **convert_tally_to_json(saved.tally)})

    def _arms(self, task: Task, stack: ExitStack) -> ArmSetup:
        """Open the ports; the stack closes them and terminates virtual arms."""
        ports = [name for name in (self.port, self.options.defender_port) if name]
        if self.port == self.options.defender_port != VIRTUAL:
            raise OptionError(
                f"--port and --defender-port are both {self.port}; give each arm the port of its own adapter."
            )
        setups = [self._setup(name, own, task, stack) for name, own in zip(ports, self.ids, strict=False)]
        clock = SteppedClock() if self.options.lockstep else MonotonicClock()
        defender = setups[1] if len(setups) > 1 else None
        return ArmSetup(
            attacker=setups[0],
            defender=defender,
            clock=clock,
            hits=self.hits,
            missed=self.options.missed,
            edges=self.options.apart == "all",
        )

    def _setup(self, name: str, own: str, task: Task, stack: ExitStack) -> Setup:
        return Setup(
            driver=Xl320(
                port=stack.enter_context(port_of(name, lockstep=self.options.lockstep)),
                joints=self._joints(name, own),
                configuration=self._configuration,
            ),
            planner=make_path_planner(),
            rate=1 / task.period,
            largest_step=self.options.largest_step,
        )

    @property
    def _configuration(self) -> Configuration:
        return Configuration(speed=self.options.speed)

    def _joints(self, port: str, own: str) -> Joints:
        return make_ergojr_joints() if port == VIRTUAL else find_joints(make_ergojr_joints(), "ergojr", own)

    def _recorder(self, plan: EvaluationPlan, environment: str, arms: ArmSetup) -> Recorder:
        """Return the conversion of rollouts to a dataset; a recording with another provenance cannot be resumed."""
        virtual = self.port == VIRTUAL
        provenance = Provenance(
            how="simulated" if virtual else "hardware",
            robot="ergojr",
            target={
                "kind": "virtual XL-320 servos" if virtual else "hardware",
                "arms": list(self.ids[: 2 if arms.defender else 1]),
                "hits": self.hits,
                "missed": self.options.missed,
                "apart": self.options.apart,
                "configuration": self._configuration.to_json(),
                "largest_step": self.options.largest_step,
            },
            signal={
                "policies": [str(path) for path in self.options.policies],
                "weights": plan.hash_weights(),
                "environment": environment,
                "episodes": self.options.episodes,
            },
            seeds=(SEED,),
            contiguous=True,
        )
        return Recorder(
            joints=arms.attacker.driver.names,
            rate=arms.attacker.rate,
            task=environment,
            objects=find_task(environment).simulator().object_feature,
            provenance=provenance,
        )

    def _make_result(
        self, plan: EvaluationPlan, environment: str, scores: list[Returns], tally: RolloutTally, path: Path | None
    ) -> CommandResult:
        groups = plan.groups(scores)
        warn_of_unequal_training(groups)
        lines = [
            f"{environment} on {self.port}, {count_of(self.options.episodes, 'episode')} per policy, "
            "deterministic actions:"
        ]
        lines += [format_policy_table(groups, {}), self._describe_rewards(), describe_tally(tally)]
        lines += [f"{count_of(len(scores), 'episode')} → {path}"] if path else []
        returns, count = [float(score.returns[0]) for score in scores], self.options.episodes
        data = {
            "environment": environment,
            "port": self.port,
            "hits": self.hits if self.options.defender_port else None,
            "missed": self.options.missed,
            "episodes": count,
            "groups": [group.describe() for group in groups],
            "returns": [returns[first : first + count] for first in range(0, len(returns), count)],
            **convert_tally_to_json(tally),
            "dataset": path,
        }
        return CommandResult("\n".join(lines), data)

    def _describe_rewards(self) -> str:
        """Return a sentence on the source of the rewards."""
        if not self.options.defender_port:
            return FORWARD_KINEMATICS
        if self.hits != SIMULATED:
            return f"Hits are read from {self.hits}."
        missed = f"; {self.options.missed:.1%} of them count as not detected" if self.options.missed else ""
        return (
            f"Hits are computed from the measured poses of sword and shield (forward kinematics of the model){missed}."
        )


def describe_tally(tally: RolloutTally) -> str:
    """Return the statistics as text."""
    sittings = f" Recorded in {tally.sittings} sessions." if tally.sittings > 1 else ""
    return (
        f"{tally.late} of {count_of(tally.steps, 'reading')} were late, {tally.missed} of them by more than a control "
        "period; "
        f"{tally.held_back} commands were not sent, because they would have led to contact; "
        f"{tally.retries} readings needed more than one attempt, and {tally.unheard} transactions were repeated "
        f"because a servo did not answer.{sittings}"
    )


def convert_tally_to_json(tally: RolloutTally) -> dict[str, int]:
    """Return the statistics for JSON."""
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
