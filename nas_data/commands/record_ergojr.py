"""Record episodes from an ErgoJr on a serial port, or from a virtual one."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from nas_data.commands._patience import Counting
from nas_data.commands.base import Command, Outcome
from nas_data.errors import OptionError

if TYPE_CHECKING:
    from nas_data.dataset.growing import Growing
    from nas_data.dataset.provenance import Provenance
    from nas_data.recorders.arm_plan import Plan
    from nas_data.recorders.session import Protocol
    from nas_data.xl320.configuration import Configuration
    from nas_data.xl320.joints import Joints

NAME = "ergojr"
FASTEST = 200.0  # [Hz] beyond what six servos answer in time at 1 Mbit/s through a USB adapter
COOLEST = 35.0  # [°C] a servo cools little further in a warm room, and the arm would rest for ever
SHUTDOWN = 65.0  # [°C] temperature limit of a new servo, XL-320 e-manual
LONGEST = 3600.0  # [s] of an episode, which is lost as a whole where something fails


@dataclass(frozen=True, kw_only=True)
class RecordErgojr(Command):
    """Record episodes from an ErgoJr; stopped at any moment, the same command goes on where it was.

    The arm goes slowly to its first pose: keep hands away. Ctrl-C stops it, holds it until it is slow and switches its
    torque off; it then sinks. What is saved stays saved.

    Example: nas record ergojr --port virtual --episodes 3 --lockstep --name try
    """

    port: str
    """Serial port of the adapter; 'virtual' for a simulated arm."""
    episodes: int = 500
    """Number of episodes; the paper's protocol has 500."""
    seconds: float = 3.0
    """Length of an episode [s]; three targets of a second each in the paper's protocol."""
    excitation: str = "steps"
    """Command signal, NAME or NAME:PARAMETER=NUMBER,…: steps, babbling, ramps, sine, multisine, triangle or chirp."""
    commands: Path | None = None
    """Play a CSV file instead: columns <joint>.pos [rad], one row a control step, optional column 'episode'."""
    start: Literal["rest", "random"] = "rest"
    """First pose of each episode: the robot's rest, or random within a fifth of each range."""
    joints: tuple[str, ...] = ()
    """Move only these joints, the others resting; all by default."""
    seed: int = 0
    """Seed of commands and poses."""
    rate: float = 100.0
    """Control rate [Hz]."""
    speed: float = 1.745
    """Speed limit in the servos [rad/s], 100°/s as in the paper's recordings; 0 for none."""
    torque: float = 1.0
    """Torque limit in the servos, a share of the largest."""
    p_gain: int = 32
    """Proportional gain in the servos' units; 32 is what the simulated arm has."""
    i_gain: int = 0
    """Integral gain; Poppy's software sets 4."""
    d_gain: int = 0
    """Derivative gain."""
    largest_step: float = 3.2
    """By how much a command may differ from the one before it [rad]; the speed limit keeps big ones slow."""
    hot: float = 55.0
    """Temperature of a servo at which the arm rests [°C]; it would shut down at 65."""
    calibration: Path | None = None
    """Calibration file; where LeRobot keeps that of --id where not given."""
    id: str = NAME
    """Name of this very arm: LeRobot's robot id."""
    finish: bool = False
    """Record nothing more: make the dataset of what is saved."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """An effect of the virtual arm, NAME:joint=JOINT,PARAMETER=NUMBER; may be given several times."""
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A fault of the virtual arm, NAME:PARAMETER=NUMBER, for example unplugged:servo=3,after=20; as often as wanted."""
    lockstep: bool = False
    """Let the virtual arm move as fast as the machine can, instead of in real time."""
    blind: bool = False
    """Keep the virtual arm's effects out of the provenance, for tests in which they are to be found."""
    name: str | None = None
    """Name of the dataset: the next version of datasets/NAME; ergojr_EXCITATION where not given."""
    out: Path | None = None
    """Write to exactly this folder instead."""

    def run(self) -> Outcome:
        """Record what is not yet saved, and make the dataset."""
        from nas_data.dataset.alone import alone
        from nas_data.dataset.growing import Growing
        from nas_data.dataset.versions import check_place
        from nas_data.recorders.under_way import place

        protocol, configuration = self._protocol(), self._configuration()
        task = self.commands.stem if self.commands else protocol.excitation.name()
        name = self.name or f"{NAME}_{task}"
        check_place(out=self.out, name=name)
        with alone(root := place(name, self.out)):
            growing = Growing(root)
            if not self.finish:
                self._record(growing, protocol, configuration)
            elif not growing.episodes:
                raise OptionError(f"Nothing is saved in {growing.root} that could be finished; record first.")
            return self._finish(growing, name)

    def _record(self, growing: "Growing", protocol: "Protocol", configuration: "Configuration") -> None:
        from nas_data.recorders.arm import Job, Recording, look
        from nas_data.recorders.arm_ways import Ways
        from nas_data.recorders.guarded import Setup
        from nas_data.recorders.schedule import MonotonicClock, SteppedClock
        from nas_data.recorders.stopping import stoppable
        from nas_data.robots.base import find_robot
        from nas_data.virtual_bus.ports import port_of
        from nas_data.xl320.arm import Xl320

        with port_of(self.port, self.effect, self.fault, self.lockstep) as port, stoppable():
            driver = Xl320(port=port, joints=self._joints(), configuration=configuration)
            look(driver)  # before the plan is drawn, which takes a while
            setup = Setup(
                driver=driver,
                ways=Ways(find_robot(NAME)),
                rate=self.rate,
                largest_step=self.largest_step,
            )
            plan, provenance = self._plan(growing, protocol), self._provenance(protocol)
            job = Job(setup=setup, plan=plan, hot=self.hot, provenance=provenance)
            clock = SteppedClock() if self.lockstep else MonotonicClock()
            Recording(job, growing, clock, say).run(Progress(growing.episodes, len(job.plan.commands)))

    def _plan(self, growing: "Growing", protocol: "Protocol") -> "Plan":
        """Draw what is to be played; where a recording is gone on with, it must be the same.

        Raises:
            OptionError: the recording under way has another plan.
        """
        from nas_data.recorders.arm import PLAN
        from nas_data.recorders.arm_plan import Plan, draw_plan, plan_key
        from nas_data.recorders.under_way import begun_with
        from nas_data.robots.base import find_robot

        robot = find_robot(NAME)
        if not growing.episodes:
            return draw_plan(robot, protocol, self.rate, self.speed, Counting("planned"))
        if not (growing.root / PLAN).is_file():  # rollouts of policies have none
            raise begun_with(growing.root, "another command")
        plan = Plan.from_bytes((growing.root / PLAN).read_bytes())
        if plan.key != plan_key(robot, protocol, self.rate, self.speed):
            raise begun_with(growing.root, "other options")
        return plan

    def _finish(self, growing: "Growing", name: str) -> Outcome:
        """Make a dataset of what is saved, and remove the recording."""
        from nas_data.dataset.content import content_hash
        from nas_data.dataset.provenance import read_provenance
        from nas_data.dataset.read import read
        from nas_data.recorders.arm_tally import Tally, summary, told
        from nas_data.recorders.under_way import complete

        dataset, provenance = read(growing.root), read_provenance(growing.root)
        assert provenance is not None
        numbers = summary(dataset, Tally.of(provenance.target))
        path = complete(growing, dataset, "\n".join(told(numbers)), name=name, out=self.out)
        text = (
            f"Recorded {dataset.n_episodes} episodes, {dataset.n_frames} frames at {dataset.fps:g} Hz.\n"
            + "\n".join(told(numbers))
            + f"\n{path}"
        )
        data = {"dataset": str(path), "episodes": dataset.n_episodes, "frames": dataset.n_frames, "fps": dataset.fps}
        return Outcome(text, {**data, **numbers, "content_hash": content_hash(dataset)})

    def _protocol(self) -> "Protocol":
        from nas_data.excitations.base import parse
        from nas_data.recorders.session import Protocol

        if self.episodes < 1 or not 0 < self.seconds <= LONGEST:
            raise OptionError(
                f"{self.episodes} episodes of {self.seconds} s cannot be recorded; "
                f"at least one is needed, of up to {LONGEST:g} s."
            )
        if not 0 < self.rate <= FASTEST:
            raise OptionError(f"--rate is {self.rate}; it must lie above 0 and up to {FASTEST:g} Hz.")
        if not self.largest_step > 0:
            raise OptionError(f"--largest-step is {self.largest_step}; it must be above zero.")
        if not COOLEST <= self.hot <= SHUTDOWN - 1:
            raise OptionError(
                f"--hot is {self.hot:g}; it must lie in {COOLEST:g} … {SHUTDOWN - 1:g} °C, "
                f"for servos shut down at {SHUTDOWN:g}."
            )
        return Protocol(
            excitation=parse(self.excitation),
            file=self.commands,
            episodes=self.episodes,
            seconds=self.seconds,
            start=self.start,
            seed=self.seed,
            joints=self.joints,
        )

    def _configuration(self) -> "Configuration":
        from nas_data.xl320.configuration import Configuration

        return Configuration(
            p_gain=self.p_gain, i_gain=self.i_gain, d_gain=self.d_gain, speed=self.speed, torque=self.torque
        )

    def _joints(self) -> "Joints":
        from nas_data.xl320.calibration import joints_of
        from nas_data.xl320.ergojr import ergojr_joints

        if self.port == "virtual" and not self.calibration:
            return ergojr_joints()
        return joints_of(ergojr_joints(), NAME, self.id, self.calibration)

    def _provenance(self, protocol: "Protocol") -> "Provenance":
        """Say where the episodes come from; a virtual arm with its effects, unless they are to be found."""
        import hashlib

        from nas_data.dataset.provenance import Provenance
        from nas_data.effects.base import parse

        virtual = self.port == "virtual"
        target: dict[str, object] = {"kind": "virtual XL-320 servos" if virtual else "hardware"}
        if virtual and not self.blind:
            target |= {"effects": [parse(text).to_json() for text in self.effect], "faults": list(self.fault)}
        file = protocol.file
        played = {"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()} if file else None
        return Provenance(
            how="simulated" if virtual else "hardware",
            robot=NAME,
            target=target,
            signal={**(played or protocol.excitation.to_json()), "start": self.start, "joints": list(self.joints)},
            seeds=(self.seed,),
            contiguous=True,
        )


class Progress:
    """Says on stderr how many episodes are saved, and how long the rest will take."""

    def __init__(self, saved: int, wanted: int) -> None:
        self._first, self._wanted = saved, wanted
        self._began = self._spoken = time.monotonic()

    def __call__(self, saved: int, warmest: float) -> None:
        """Report: on a terminal each episode, elsewhere at most every two seconds."""
        now = time.monotonic()
        if not sys.stderr.isatty() and now - self._spoken < 2.0:
            return
        self._spoken = now
        left = (now - self._began) / (saved - self._first) * (self._wanted - saved)
        say(f"saved {saved} of {self._wanted} episodes, {left / 60:.0f} min left, servos up to {warmest:.0f} °C")


def say(text: str) -> None:
    """Tell a person something at once."""
    print(text, file=sys.stderr, flush=True)
