"""Add what a source simulator predicts for every transition, as a new version."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands._actuators import TakesModel
from nas_data.commands.base import Outcome

if TYPE_CHECKING:
    from nas_data.dataset.dataset import Dataset
    from nas_data.effects.base import Effect
    from nas_data.robots.base import Robot


@dataclass(frozen=True, kw_only=True)
class Pair(TakesModel):
    """Reset a source to every measured state, hold the command for one control step, store what it predicts.

    Example: nas pair datasets/arm --model arm.xml
    """

    dataset: tyro.conf.Positional[Path]
    """Dataset: a version's folder, or datasets/NAME for its newest version."""
    model: str
    """Source: an MJCF or URDF file whose joints carry the dataset's names, or a robot's name."""
    engine: str = "mujoco"
    """mujoco or bullet."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """Effect to add to the source, NAME:joint=JOINT,PARAMETER=NUMBER; may be given several times."""
    effects: Path | None = None
    """A gap report's folder, or its effects.json: effects to add to the source, and its retuned base."""
    out: Path | None = None
    """Exact folder of the new version; beside the dataset where it lies in datasets/NAME/ otherwise."""

    def run(self) -> Outcome:
        """Pair the dataset and write the new version."""
        import time

        from nas_data.dataset import versions
        from nas_data.dataset.foreign import take_in, warn
        from nas_data.dataset.provenance import Provenance, read_provenance
        from nas_data.dataset.read import read
        from nas_data.effects.base import parse
        from nas_data.gap.named import Named
        from nas_data.pairing import object_warnings, pair, warn_of_ranges
        from nas_data.robots.base import find_robot
        from nas_data.simulators.engines import load_simulator

        root = versions.resolve(self.dataset)
        versions.check_place(out=self.out, parent=root)
        recorded = read(root)
        dataset, derived, noticed = take_in(root, recorded)
        named = Named.read(self.effects) if self.effects else None
        effects = (*map(parse, self.effect), *(named.effects if named else ()))
        plain = find_robot(self.actuated(self.model))
        robot = named.robot(plain, dataset.joints) if named else plain
        simulator = load_simulator(robot, 1 / dataset.fps, dataset.joints, effects, self.engine)
        started = time.perf_counter()
        paired = pair(dataset, simulator)
        seconds = time.perf_counter() - started
        before = read_provenance(root) or Provenance(how="lerobot", robot=dataset.robot_type)
        provenance = replace(
            Provenance(how="paired"),
            robot=before.robot,
            source=simulator.describe(),
            target=before.target,
            signal=before.signal,
            seeds=before.seeds,
            parents=(versions.parent_of(root, recorded),),
            derived={**before.derived, **derived},
            contiguous=before.contiguous,
            notes=before.notes,
        )
        warnings = [*noticed, *warn_of_ranges(dataset, robot.spec().compile()), *object_warnings(dataset, simulator)]
        warn(warnings)
        files, remark = self._kept_source(robot, effects, paired)
        kept = {f"meta/{name}": content for name, content in files.items()}
        folder = versions.save(paired, provenance, out=self.out, parent=root, attachments=kept)
        notes = [f"  derived {key}: {how}" for key, how in derived.items()]
        notes += [f"  {remark}"] if remark else []
        text = f"{paired.n_frames} transitions of {paired.n_episodes} episodes paired in {seconds:.1f} s → {folder}"
        return Outcome(
            "\n".join([text, *notes]),
            {
                "dataset": folder,
                "content_hash": read_provenance(folder).content_hash,  # type: ignore[union-attr]  # just written
                "transitions": paired.n_frames,
                "seconds": seconds,
                "derived": derived,
                "source": simulator.describe(),
                "warnings": [*warnings, *([remark] if remark else [])],
            },
        )

    def _kept_source(
        self, robot: "Robot", effects: "Sequence[Effect]", paired: "Dataset"
    ) -> tuple[Mapping[str, bytes], str | None]:
        """Return the files that keep the source with the dataset, and what they lack; none that predict otherwise."""
        from nas_data.errors import NasError
        from nas_data.sources import check_kept, left_out, source_files

        files, remark = source_files(robot, effects), left_out(robot)
        if remark is None:
            return files, None
        try:
            check_kept(files, paired, self.engine)
        except NasError:
            return {}, (
                "the source's colliding meshes touch something in these motions, and without their files it would "
                f"predict otherwise: it is not kept, later commands need --model {self.actuated(self.model)} again"
            )
        return files, remark
