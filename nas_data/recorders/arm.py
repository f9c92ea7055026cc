"""Recording of an arm: each episode is saved before the next begins, and the arm is safe at the end."""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Self

import numpy as np

from nas_data.dataset.incremental_writer import IncrementalWriter
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.target_episodes import read_history
from nas_data.errors import ArmError
from nas_data.hardware.arms.base import Arm, Driver, Registers
from nas_data.joint_units import find_joint_unit
from nas_data.recorders.arm_dataset import to_dataset
from nas_data.recorders.arm_motion import ArmEpisode, ArmMotion
from nas_data.recorders.arm_plan import MotionPlan
from nas_data.recorders.arm_tally import RecordingStats
from nas_data.recorders.guarded import GuardedArm, Setup
from nas_data.recorders.recording_folder import SAVING, describe_progress, make_other_recording_error
from nas_data.recorders.retry import TRANSIENT_ERRORS
from nas_data.recorders.schedule import Clock

PLAN = "meta/plan.npz"
SHARED_SETTINGS = {  # names for the user of settings in which two sessions may differ
    "robot": "robot",
    "kind": "kind of arm (hardware or virtual)",
    "effects": "set of effects (--effect)",
    "ids": "set of servo IDs",
    "calibration": "calibration",
    "zero_offsets_ticks": "calibration",
    "zeros_counts": "zero of a joint (--zero)",
    "per_count": "direction of a joint (--reverse)",
}
FAR = 0.35  # [rad] from a pose after a slow approach: more than servos sag (11° on the virtual ErgoJr)
TRIES = 3  # attempts at an episode; the last one is kept with missed readings, and raises on a bus error


@dataclass(frozen=True, kw_only=True)
class Job:
    """A recording task.

    Attributes:
        setup: The arm and its motion settings.
        plan: Commands and first poses.
        hot: Temperature at which the arm pauses [°C].
        provenance: Origin of the episodes, without the description that the arm gives of itself.
    """

    setup: Setup
    plan: MotionPlan
    hot: float
    provenance: Provenance


def check_arm(driver: Driver) -> Mapping[str, object]:
    """Check that an arm can be recorded, and return its description; nothing moves.

    Raises:
        ArmError: the arm cannot be used, with the reason.
    """
    arm = driver.open(time.monotonic)
    try:
        arm.check()
        return arm.describe()
    finally:
        arm.close()


def check_same_arm(growing: IncrementalWriter, provenance: Provenance) -> None:
    """Check that a recording is resumed with the arm and the joint frame of its saved episodes.

    Args:
        growing: The saved episodes.
        provenance: Origin of the episodes to come, with the description of the arm.

    Raises:
        OptionError: the arm or its frame differs; the message says in what.
    """
    known = read_provenance(growing.root) if growing.episodes else None
    if known is None:
        return
    earlier, now = list_shared_settings(known), list_shared_settings(provenance)
    other = dict.fromkeys(word for key, word in SHARED_SETTINGS.items() if earlier[key] != now[key])
    if other:
        raise make_other_recording_error(growing.root, f"another {' and another '.join(other)}")


def list_shared_settings(provenance: Provenance) -> dict[str, object]:
    """Return the settings that all episodes of a recording must share, by the keys of `SHARED_SETTINGS`."""
    values = {"robot": provenance.robot, **(provenance.target or {})}
    return {key: json.loads(json.dumps(values.get(key))) for key in SHARED_SETTINGS}


class Settings:
    """History of the servos' settings during a recording: the registers, with the first episode for which they hold."""

    def __init__(self, known: Mapping[int, Registers] | None = None) -> None:
        self._known = dict(known or {})

    @classmethod
    def of(cls, target: Mapping[str, object] | None) -> Self:
        """Read the history from a recording's provenance."""
        return cls(dict(read_history(target or {})))

    def record(self, episode: int, registers: Registers) -> None:
        """Add the registers read before an episode; entries of this and of later episodes are dropped."""
        self._known = {number: known for number, known in self._known.items() if number < episode}
        if not self._known or self._known[max(self._known)] != registers:
            self._known[episode] = registers

    def to_json(self) -> list[dict[str, object]]:
        """Return the history for provenance: each entry has its first episode and the registers of each joint."""
        return [{"from_episode": number, "joints": known} for number, known in sorted(self._known.items())]


class RecordingJob:
    """A recording in progress; a later one with the same plan resumes it.

    Attributes:
        growing: The saved episodes.
        tally: Statistics of the recording so far.
    """

    def __init__(self, job: Job, growing: IncrementalWriter, clock: Clock, say: Callable[[str], None]) -> None:
        """Prepare; nothing moves yet.

        Args:
            job: The recording task.
            growing: Dataset that receives the episodes.
            clock: Clock of the control loop.
            say: Called with messages for the user.
        """
        self.growing, self._job, self._clock, self._say = growing, job, clock, say
        known = read_provenance(growing.root) if growing.episodes else None
        self.tally = RecordingStats.of(known.target if known else None)
        self.tally.sittings += 1
        self._settings = Settings.of(known.target if known else None)
        self._behind: set[str] = set()

    def run(self, progress: Callable[[int, float], None]) -> None:
        """Record the missing episodes; always leave the arm without torque.

        Args:
            progress: Called after each episode with the number of saved ones and the highest temperature [°C].

        Raises:
            ArmError: the arm failed; the message says how many episodes are saved, and where.
        """
        guarded = GuardedArm(self._job.setup, self._clock)
        try:
            with guarded:
                self._record_all(guarded, progress)
        except ArmError as error:
            raise type(error)(f"{error} {self._describe_saved()}") from error
        except KeyboardInterrupt:
            self._say(self._describe_saved())
            raise
        finally:
            if guarded.safety_warning:
                self._say(guarded.safety_warning)

    def _record_all(self, guarded: GuardedArm, progress: Callable[[int, float], None]) -> None:
        poses = self._job.plan.poses
        motion = guarded.take(poses[min(self.growing.episodes, len(poses) - 1)])
        for number in range(self.growing.episodes, len(poses)):
            motion = self._record(guarded, motion, number)
            progress(number + 1, float(motion.vitals.temperature.max()))
        motion.approach(poses[-1])

    def _record(self, guarded: GuardedArm, motion: ArmMotion, number: int) -> ArmMotion:
        """Record and save one episode; return the arm's motion, which a restart replaces."""
        arm = guarded.arm
        for left in reversed(range(TRIES)):
            before = arm.retries
            try:
                episode = self._play(motion, number)
            except TRANSIENT_ERRORS as error:
                if not left:
                    raise
                self._say(f"{error} Episode {number} is recorded again.")
                motion = self._retake_arm(guarded, number)
            else:
                missed = int(episode.missed(motion.period).sum())
                self.tally.missed += missed
                if not missed or not left:
                    break
            finally:
                self.tally.retries += arm.retries - before
            self.tally.anew += 1
        self._save(guarded, episode)
        return motion

    def _play(self, motion: ArmMotion, number: int) -> ArmEpisode:
        pose = self._job.plan.poses[number]
        self._report_joints_behind(motion.approach(pose) - pose)
        if motion.vitals.temperature.max() >= self._job.hot:
            self._cool(motion, pose)
        self._settings.record(number, motion.arm.registers())
        return motion.play(self._job.plan.commands[number])

    def _report_joints_behind(self, deviations: np.ndarray) -> None:
        """Tell the user once of each joint that stays far from a pose [rad; m], shape (n,), after a slow approach."""
        setup = self._job.setup
        for name, deviation, radian in zip(setup.driver.names, deviations, setup.planner.radians, strict=True):
            if abs(deviation) > FAR * radian and name not in self._behind:
                self._behind.add(name)
                distance = find_joint_unit(name, setup.planner.slides).text(abs(deviation), 1)
                self._say(
                    f"{name} stays {distance} from a pose to which it went slowly: "
                    "something blocks it, its servo is too weak, or its readings are shifted. The recording goes on."
                )

    def _cool(self, motion: ArmMotion, pose: np.ndarray) -> None:
        """Wait in the rest pose until the warmest servo has cooled."""
        self.tally.pauses += 1
        self._say(f"A servo has {motion.vitals.temperature.max():.0f} °C; the arm pauses until it is cooler.")
        motion.cool(pose, self._job.hot)

    def _retake_arm(self, guarded: GuardedArm, number: int) -> ArmMotion:
        """Take the arm again after a bus error, to repeat an episode."""
        guarded.recover()
        return guarded.take(self._job.plan.poses[number])

    def _save(self, guarded: GuardedArm, episode: ArmEpisode) -> None:
        job = self._job
        guarded.extend_deadline(SAVING)
        setup = job.setup
        robot, slides = job.provenance.robot, setup.planner.slides
        dataset = to_dataset(episode, setup.driver.names, setup.rate, job.plan.task, robot, slides)
        plan = {PLAN: job.plan.to_bytes()} if not self.growing.episodes else {}
        self.growing.append(dataset, self._provenance(guarded.arm), plan)

    def _provenance(self, arm: Arm) -> Provenance:
        known: Mapping[str, object] = self._job.provenance.target or {}
        made = {
            "tally": asdict(self.tally),
            "drawn_again": self._job.plan.replaced,
            "registers": self._settings.to_json(),
        }
        return replace(self._job.provenance, target={**arm.describe(), **known, **made})

    def _describe_saved(self) -> str:
        return describe_progress(self.growing.root, self.growing.episodes, len(self._job.plan.commands))
