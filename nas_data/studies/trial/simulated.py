"""A simulated arm for a trial: each known change is an effect of the target."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from nas_data.api.recording import record
from nas_data.count_of import count_of
from nas_data.dataset.origin import describe
from nas_data.dataset.versions import save
from nas_data.effects.base import Effect, add_effects, parse
from nas_data.errors import ModelFileError
from nas_data.mjcf.arm_ends import list_arm_ends
from nas_data.robots.base import find_deepest_joint, find_robot
from nas_data.studies.trial.change import ChangeNotMade, KnownChange, TestedArm


@dataclass(frozen=True, kw_only=True)
class SimulatedArm:
    """Records a simulated arm.

    Attributes:
        robot: A robot's name, or a model file.
        effects: Its own effects, in command-line syntax: what it has in the baseline, too.
        excitation: Command signal.
        episodes: Number of episodes of a recording.
        seconds: Length of each [s].
        rate: Control rate [Hz]; None for the robot's.
        noise: Standard deviation of the measured positions [rad].
        seed: Seed of commands and noise; recordings of changes have the same commands and other noise.
        hung: Mass that is hung on the last link [kg]; None for the mass of that link.
    """

    robot: str
    effects: tuple[str, ...]
    excitation: str
    episodes: int
    seconds: float
    rate: float | None
    noise: float
    seed: int
    hung: float | None

    @property
    def name(self) -> str:
        """Name of the arm."""
        return find_robot(self.robot).name

    @property
    def mass(self) -> float:
        """Mass that is hung on the last link [kg]; 0 for none."""
        if self.hung is not None:
            return self.hung
        robot = find_robot(self.robot)
        spec = robot.spec()
        model = spec.compile()
        last = find_deepest_joint(spec, list_arm_ends(spec, robot.joints))
        body = int(model.joint(last).bodyid[0])
        return float(model.body_subtreemass[body])

    def describe(self) -> Mapping[str, object]:
        """Return the settings of the recordings for JSON."""
        return {**vars(self), "effects": list(self.effects)}

    def record_baseline(self, folder: Path) -> Sequence[str]:
        """Record the arm with its own effects."""
        return self._record(folder, (), self.seed)

    def record_change(self, folder: Path, change: KnownChange, arm: TestedArm) -> Sequence[str]:
        """Record the arm with a change; see `ArmRecorder.record_change`."""
        expected = change.expect(arm)
        try:
            add_effects(find_robot(self.robot).spec(), [*map(parse, self.effects), expected])
        except ModelFileError as error:
            raise ChangeNotMade(str(error)) from None
        return self._record(folder, (expected,), self.seed + zlib.crc32(change.name.encode()))

    def _record(self, folder: Path, changes: Sequence[Effect], noise_seed: int) -> Sequence[str]:
        dataset = record(
            self.robot,
            effects=[*self.effects, *changes],
            excitation=self.excitation,
            episodes=self.episodes,
            seconds=self.seconds,
            rate=self.rate,
            noise=self.noise,
            seed=self.seed,
            noise_seed=noise_seed,
            blind=True,
        )
        provenance, _ = describe(dataset)
        save(dataset, provenance, out=folder)
        return [
            f"{count_of(dataset.n_episodes, 'episode')}, {dataset.n_frames / dataset.fps:.0f} s of motion → {folder}"
        ]
