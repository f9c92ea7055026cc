"""Base of the commands that record an arm: options, plan, recording and dataset."""

from abc import abstractmethod
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.count_of import count_of
from nas_data.errors import OptionError
from nas_data.runs.progress import Counting, say

if TYPE_CHECKING:
    from nas_data.dataset.incremental_writer import IncrementalWriter
    from nas_data.dataset.provenance import Provenance
    from nas_data.hardware.arms.base import Driver
    from nas_data.recorders.arm_plan import MotionPlan
    from nas_data.recorders.session import PlaybackProtocol
    from nas_data.robots.base import Robot

COOLEST = 35.0  # [°C] lower thresholds may never be reached in a warm room, so that the arm would rest for ever
SHUTDOWN = 65.0  # [°C] lowest temperature limit of a new servo, XL-320 e-manual
LONGEST = 3600.0  # [s] of an episode, which is lost as a whole after a failure
VIRTUAL = "virtual"


@dataclass(frozen=True, kw_only=True)
class RecordArm(Command):
    """Base of the commands that record an arm."""

    FASTEST: ClassVar[float]  # control rate [Hz] above which servos do not answer in time

    episodes: int = 500
    """Number of episodes; the paper's protocol has 500."""
    seconds: float = 3.0
    """Length of an episode [s]; three targets of one second each in the paper's protocol."""
    excitation: str = "steps"
    """Command signal, NAME or NAME:PARAMETER=NUMBER,…, such as steps or ramps:every=20; a wrong NAME or PARAMETER is
    answered with those that exist."""
    commands: Path | None = None
    """Play a CSV file instead: columns <joint>.pos [rad], one row per control step, optional column 'episode'."""
    start: Literal["rest", "random"] = "rest"
    """First pose of each episode: the robot's rest pose, or random within a fifth of each range."""
    joints: tuple[str, ...] = ()
    """Move only these joints; the others hold their rest position. All by default."""
    seed: int = 0
    """Seed of commands and poses."""
    hot: float = 55.0
    """Servo temperature at which the arm pauses [°C]; servos shut down at 65."""
    finish: bool = False
    """Record no more episodes: write the dataset of the saved ones."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """An effect of the virtual arm, NAME:joint=JOINT,PARAMETER=NUMBER; may be given several times."""
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A fault of the virtual arm, NAME:PARAMETER=NUMBER, as in unplugged:servo=3,after=20; may be given several
    times."""
    lockstep: bool = False
    """Simulate the virtual arm as fast as the machine can, instead of in real time."""
    blind: bool = False
    """Omit the virtual arm's effects from the provenance, to test whether they are found."""
    name: str | None = None
    """Name of the dataset: the next version of datasets/NAME; ROBOT_EXCITATION by default."""
    out: Path | None = None
    """Write to exactly this folder instead of a version of datasets/NAME."""
    rate: float
    speed: float

    @property
    @abstractmethod
    def kind(self) -> str:
        """Name of the robot in datasets."""

    @property
    @abstractmethod
    def virtual(self) -> bool:
        """Whether the arm is simulated."""

    @property
    @abstractmethod
    def step(self) -> float:
        """Largest difference between successive commands [rad]."""

    @abstractmethod
    def arm_model(self) -> "Robot":
        """Return the model for collision checks."""

    @abstractmethod
    def driver(self) -> "AbstractContextManager[Driver]":
        """Return a context that yields the driver of the arm."""

    @abstractmethod
    def simulated(self) -> str:
        """Return a phrase for the kind of virtual arm."""

    def run(self) -> CommandResult:
        """Record the episodes that are not saved yet, and write the dataset."""
        from nas_data.dataset.incremental_writer import IncrementalWriter
        from nas_data.dataset.versions import check_destination, make_name
        from nas_data.dataset.write_lock import hold_write_lock
        from nas_data.recorders.recording_folder import choose_recording_folder

        protocol, step = self._protocol(), self.step
        task = self.commands.stem if self.commands else protocol.excitation.name()
        name = self.name or make_name(f"{self.kind}_{task}")
        check_destination(out=self.out, name=name)
        with hold_write_lock(root := choose_recording_folder(name, self.out)):
            growing = IncrementalWriter(root)
            if not self.finish:
                self._record(growing, protocol, step)
            elif not growing.episodes:
                raise OptionError(
                    f"There are no saved episodes in {growing.root}; record some before you use --finish."
                )
            return self._finish(growing, name)

    def _record(self, growing: "IncrementalWriter", protocol: "PlaybackProtocol", step: float) -> None:
        from nas_data.recorders.arm import Job, RecordingJob, check_arm, check_same_arm
        from nas_data.recorders.guarded import Setup
        from nas_data.recorders.path_planner import PathPlanner
        from nas_data.recorders.schedule import MonotonicClock, SteppedClock
        from nas_data.recorders.stopping import stop_on_signals

        robot = self.arm_model()
        with self.driver() as driver, stop_on_signals():
            description = check_arm(driver)  # before the plan, which takes a while
            setup = Setup(
                driver=driver,
                planner=PathPlanner(restrict_to_arm(robot, driver)),
                rate=self.rate,
                largest_step=step,
            )
            plan, provenance = self._plan(growing, protocol, restrict_to_arm(robot, driver)), self._provenance(protocol)
            check_same_arm(growing, replace(provenance, target={**description, **(provenance.target or {})}))
            job = Job(setup=setup, plan=plan, hot=self.hot, provenance=provenance)
            clock = SteppedClock() if self.lockstep else MonotonicClock()
            count, wanted = Counting("saved"), len(plan.commands)
            count(growing.episodes, wanted)
            recording = RecordingJob(job, growing, clock, say)
            recording.run(lambda saved, warmest: count(saved, wanted, f"servos up to {warmest:.0f} °C"))

    def _plan(self, growing: "IncrementalWriter", protocol: "PlaybackProtocol", robot: "Robot") -> "MotionPlan":
        """Return the plan of the recording; raise OptionError if a resumed recording has another plan."""
        from nas_data.recorders.arm import PLAN
        from nas_data.recorders.arm_plan import MotionLimits, MotionPlan, draw_plan, plan_key
        from nas_data.recorders.recording_folder import make_other_recording_error

        limits = MotionLimits(self.rate, self.speed, self.step)
        if not growing.episodes:
            return draw_plan(robot, protocol, limits, Counting("planned"))
        if not (growing.root / PLAN).is_file():  # recordings of policy rollouts have no plan
            raise make_other_recording_error(growing.root, "another command")
        plan = MotionPlan.from_bytes((growing.root / PLAN).read_bytes())
        if plan.key != plan_key(robot, protocol, limits):
            raise make_other_recording_error(growing.root, "other options, or by another version of nas_data")
        return plan

    def _finish(self, growing: "IncrementalWriter", name: str) -> CommandResult:
        """Write the dataset of the saved episodes, and remove the recording."""
        from nas_data.dataset.content import hash_content
        from nas_data.dataset.provenance import read_provenance
        from nas_data.dataset.read import read
        from nas_data.recorders.arm_tally import RecordingQuality, RecordingStats
        from nas_data.recorders.recording_folder import complete

        dataset, provenance = read(growing.root), read_provenance(growing.root)
        assert provenance is not None
        quality = RecordingQuality.of(dataset, RecordingStats.of(provenance.target))
        notes = "\n".join(quality.lines())
        path = complete(growing, dataset, notes, name=name, out=self.out)
        head = (
            f"Recorded {count_of(dataset.n_episodes, 'episode')}, {count_of(dataset.n_frames, 'frame')} at "
            f"{dataset.fps:g} Hz."
        )
        data = {"dataset": str(path), "episodes": dataset.n_episodes, "frames": dataset.n_frames, "fps": dataset.fps}
        return CommandResult(
            f"{head}\n{notes}\n{path}", {**data, **quality.to_json(), "content_hash": hash_content(dataset)}
        )

    def _protocol(self) -> "PlaybackProtocol":
        from nas_data.excitations.base import parse
        from nas_data.recorders.session import PlaybackProtocol, check_amount

        check_amount(self.episodes, self.seconds, LONGEST)
        if not 0 < self.rate <= self.FASTEST:
            raise OptionError(f"--rate is {self.rate}; it must be above 0 and at most {self.FASTEST:g} Hz.")
        if not COOLEST <= self.hot <= SHUTDOWN - 1:
            raise OptionError(
                f"--hot is {self.hot:g}; it must be in {COOLEST:g} … {SHUTDOWN - 1:g} °C, because servos shut down at "
                f"{SHUTDOWN:g} °C."
            )
        return PlaybackProtocol(
            excitation=parse(self.excitation),
            file=self.commands,
            episodes=self.episodes,
            seconds=self.seconds,
            start=self.start,
            seed=self.seed,
            joints=self.joints,
        )

    def _provenance(self, protocol: "PlaybackProtocol") -> "Provenance":
        """Return the provenance; it includes the effects of a virtual arm, unless the recording is blind."""
        from nas_data.dataset.provenance import Provenance
        from nas_data.effects.base import parse

        target: dict[str, object] = {"kind": self.simulated() if self.virtual else "hardware"}
        if self.virtual and not self.blind:
            target |= {"effects": [parse(text).to_json() for text in self.effect], "faults": list(self.fault)}
        return Provenance(
            how="simulated" if self.virtual else "hardware",
            robot=self.kind,
            target=target,
            signal={**protocol.signal(), "largest_step": self.step},
            seeds=(self.seed,),
            contiguous=True,
        )


def restrict_to_arm(robot: "Robot", driver: "Driver") -> "Robot":
    """Return the model with only the arm's joints, in their order."""
    if robot.joints == driver.names:
        return robot
    rest = dict(zip(robot.joints, robot.rest, strict=False))
    return replace(robot, joints=driver.names, rest=tuple(rest[name] for name in driver.names if name in rest))
