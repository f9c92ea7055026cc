"""The recording of an ErgoJr: each episode is on the disk before the next begins, and the arm is safe at the end."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from nas_data.dataset.growing import Growing
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.errors import ArmError, BadReply, GuardLost, NobodyAnswers, ServoSilent
from nas_data.recorders.ergojr_dataset import to_dataset
from nas_data.recorders.ergojr_motion import Episode, Motion
from nas_data.recorders.ergojr_plan import Plan
from nas_data.recorders.ergojr_tally import Tally
from nas_data.recorders.ergojr_ways import Ways
from nas_data.recorders.schedule import Clock
from nas_data.recorders.watchdog import Watchdog
from nas_data.xl320.arm import Arm
from nas_data.xl320.configuration import Configuration
from nas_data.xl320.joints import Joints

PLAN = "meta/plan.npz"
TRIES = 3  # times that an episode is begun before it is given up, or taken with readings that were missed
REST = 1.0  # [s] that a line has to recover
COOLING = 5.0  # [s] between two looks at an arm that cools
SAVING = 30.0  # [s] that the disk may take for an episode while the arm stands still
SETTING_UP = 10.0  # [s] that it may take to look at an arm, to set it up or to make it safe
COOL = 5.0  # [°C] below the limit at which it goes on
PASSING = (BadReply, ServoSilent, NobodyAnswers)  # what may have been a loose plug or noise


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is to be recorded, and how.

    Attributes:
        port: Where the arm is.
        joints: Its joints.
        ways: How it gets from pose to pose without touching anything.
        plan: Commands and first poses.
        rate: Control rate [Hz].
        configuration: Set-up of the servos.
        largest_step: By how much a command may differ from the one before [rad].
        hot: Temperature at which the arm pauses [°C].
        provenance: Where the episodes come from, without what the arm says itself.
    """

    port: str
    joints: Joints
    ways: Ways
    plan: Plan
    rate: float
    configuration: Configuration
    largest_step: float
    hot: float
    provenance: Provenance


def look(port: str, joints: Joints) -> None:
    """Find out whether an arm could be recorded; nothing moves.

    Raises:
        ArmError: says why not.
    """
    arm = Arm(port, joints)
    try:
        arm.check()
    finally:
        arm.close()


class Recording:
    """A job under way; a second one of the same plan goes on where the first stopped.

    Attributes:
        growing: What is saved.
        tally: What happened so far.
    """

    def __init__(self, job: Job, growing: Growing, clock: Clock, say: Callable[[str], None]) -> None:
        """Prepare; nothing moves yet.

        Args:
            job: What is to be recorded.
            growing: Where.
            clock: By which.
            say: Told what a person should know at once.
        """
        self.growing, self._job, self._clock, self._say = growing, job, clock, say
        known = read_provenance(growing.root) if growing.episodes else None
        self.tally = Tally.of(known.target if known else None)
        self.tally.sittings += 1

    def run(self, progress: Callable[[int, float], None]) -> None:
        """Record what is not yet saved; leave the arm without torque, whatever happens.

        Args:
            progress: Told after each episode how many are saved, and the warmest servo [°C].

        Raises:
            ArmError: something is wrong with the arm; says how many episodes are saved, and where.
        """
        job = self._job
        arm = Arm(job.port, job.joints, self._clock.now)
        self._watchdog = Watchdog(job.port, job.joints)
        try:
            motion = self._take(arm, self.growing.episodes)
            for number in range(self.growing.episodes, len(job.plan.commands)):
                motion = self._record(arm, motion, number)
                progress(number + 1, float(motion.vitals.temperature.max()))
            motion.approach(job.plan.poses[-1])
        except ArmError as error:
            raise type(error)(f"{error} {self._saved()}") from error
        except KeyboardInterrupt:
            self._say(self._saved())
            raise
        finally:
            with contextlib.suppress(GuardLost):
                self._watchdog.promise(SETTING_UP)
            doubt = arm.make_safe()
            arm.close()
            self._watchdog.release()
            if doubt:
                self._say(doubt)

    def _take(self, arm: Arm, number: int) -> Motion:
        """Look at the arm and for a way to an episode's first pose, set it up, switch its torque on."""
        job = self._job
        self._watchdog.promise(SETTING_UP)
        arm.check()
        poses = job.plan.poses
        job.ways.find(arm.read().positions, poses[min(number, len(poses) - 1)])
        arm.configure(job.configuration)
        arm.torque_on()
        return Motion(arm, self._clock, 1 / job.rate, job.largest_step, job.ways, self._watchdog.promise)

    def _record(self, arm: Arm, motion: Motion, number: int) -> Motion:
        """Record one episode and save it; return who moves the arm now."""
        for left in reversed(range(TRIES)):
            before = arm.retries
            try:
                episode = self._play(motion, number)
            except PASSING as error:
                if not left:
                    raise
                self._say(f"{error} Episode {number} is recorded anew.")
                motion = self._again(arm, number)
            else:
                missed = int(episode.missed(1 / self._job.rate).sum())
                self.tally.missed += missed
                if not missed or not left:
                    break
            finally:
                self.tally.retries += arm.retries - before
            self.tally.anew += 1
        self._save(arm, episode)
        return motion

    def _play(self, motion: Motion, number: int) -> Episode:
        pose = self._job.plan.poses[number]
        motion.approach(pose)
        if motion.vitals.temperature.max() >= self._job.hot:
            self._cool(motion, pose)
        return motion.play(self._job.plan.commands[number])

    def _cool(self, motion: Motion, pose: np.ndarray) -> None:
        """Wait in the rest pose until the warmest servo has cooled."""
        self.tally.pauses += 1
        self._say(f"A servo has {motion.vitals.temperature.max():.0f} °C; the arm rests until it is cooler.")
        while motion.vitals.temperature.max() > self._job.hot - COOL:
            motion.hold(pose, COOLING)

    def _again(self, arm: Arm, number: int) -> Motion:
        """Begin an episode anew with an arm whose line failed."""
        self._watchdog.promise(SETTING_UP)
        arm.make_safe()
        self._clock.wait_until(self._clock.now() + REST)
        return self._take(arm, number)

    def _save(self, arm: Arm, episode: Episode) -> None:
        job = self._job
        dataset = to_dataset(episode, job.joints, job.rate, job.plan.task)
        plan = {PLAN: job.plan.to_bytes()} if not self.growing.episodes else {}
        self._watchdog.promise(SAVING)
        self.growing.append(dataset, self._provenance(arm), plan)

    def _provenance(self, arm: Arm) -> Provenance:
        known: Mapping[str, object] = self._job.provenance.target or {}
        made = {"tally": asdict(self.tally), "drawn_again": self._job.plan.replaced}
        return replace(self._job.provenance, target={**arm.describe(), **known, **made})

    def _saved(self) -> str:
        count, wanted = self.growing.episodes, len(self._job.plan.commands)
        if not count:
            return "Nothing was recorded yet."
        return f"{count} of {wanted} episodes are saved in {self.growing.root}; the same command goes on from there."
