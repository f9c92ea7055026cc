"""The source of a dataset or checkpoint: the model named on the command line, or the one stored with the data."""

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.dataset.dataset import Dataset
from nas_data.dataset.layout import PROVENANCE, SOURCE, SOURCE_EFFECTS, read_json
from nas_data.effects.base import Effect, read_effects
from nas_data.errors import ModelFileError
from nas_data.log import hide_warnings
from nas_data.mjcf.strip_meshes import count_colliding_geoms, format_exact_xml, needs_files, strip_meshes
from nas_data.pairing import check_source
from nas_data.robots.base import Robot, find_robot, list_slide_joints
from nas_data.simulators.base import Simulator
from nas_data.simulators.engines import ENGINES, load_simulator
from nas_data.simulators.servo_registers import ServoRegisters

MODEL, EFFECTS = Path(SOURCE).name, Path(SOURCE_EFFECTS).name


def collect_source_files(robot: Robot, effects: Sequence[Effect] = ()) -> dict[str, bytes]:
    """Return the files that make a paired dataset or a checkpoint self-contained: the source's MJCF and its effects.

    A model with meshes or textures is stored without them: see `strip_meshes`.
    """
    files = {MODEL: _serialise_model(robot)}
    if effects:
        slides = list_slide_joints(robot.spec())
        files[EFFECTS] = json.dumps([effect.to_json(slides) for effect in effects], indent=1).encode()
    return files


def _serialise_model(robot: Robot) -> bytes:
    """Return a robot's model as one file."""
    spec = robot.spec()
    if needs_files(spec):
        return format_exact_xml(strip_meshes(spec))
    if robot.edit is None and b"<include" not in robot.mjcf.read_bytes():
        return robot.mjcf.read_bytes()
    return format_exact_xml(spec)


def describe_left_out(robot: Robot) -> str | None:
    """Describe the parts that the stored source lacks and that may have affected pairing; None if there are none."""
    spec = robot.spec()
    shapes = count_colliding_geoms(spec) if needs_files(spec) else 0
    if not shapes:
        return None
    meshes = "mesh" if shapes == 1 else "meshes"
    return (
        f"the source is stored without its {shapes} colliding {meshes}, so that it needs no other files: their "
        f"contacts are not simulated. Give --model {robot.mjcf} to later commands if these contacts matter"
    )


def check_kept(files: Mapping[str, bytes], paired: Dataset, engine: str) -> None:
    """Check that source files predict what a paired dataset holds.

    Raises:
        JointMismatch: they predict otherwise.
    """
    with tempfile.TemporaryDirectory() as folder, hide_warnings():
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        check_source(paired, find_source(None, (), paired, [Path(folder)], engine))


def read_kept_files(root: Path) -> dict[str, bytes]:
    """Return the source's files stored in a dataset (under `meta/`) or a checkpoint; empty if there are none."""
    for folder in (root / "meta", root):
        if (folder / MODEL).is_file():
            return {name: (folder / name).read_bytes() for name in (MODEL, EFFECTS) if (folder / name).is_file()}
    return {}


def read_kept_engine(root: Path) -> str:
    """Return the physics engine of a dataset's pairing or a checkpoint's training, from provenance."""
    dataset, checkpoint = root / PROVENANCE, root / "config.json"
    if not (path := dataset if dataset.is_file() else checkpoint).is_file():
        return ENGINES[0]
    content = read_json(path)
    provenance = content if path == dataset else content.get("provenance")
    source = provenance.get("source") if isinstance(provenance, dict) else None
    return str(source.get("engine", ENGINES[0])) if isinstance(source, dict) else ENGINES[0]


@dataclass(frozen=True)
class SourceModel:
    """Specification of a source.

    Attributes:
        model: A robot, its name or a model file.
        effects: Effects to add to the model.
        engine: `mujoco` or `bullet`.
    """

    model: str | Path | Robot
    effects: tuple[Effect, ...] = ()
    engine: str = ENGINES[0]

    @property
    def robot(self) -> Robot:
        """The robot of its model."""
        return self.model if isinstance(self.model, Robot) else find_robot(self.model)

    def modules(self) -> tuple[str, ...]:
        """Return the modules of this package that determine its motion, for `code_hash`."""
        return (f"nas_data.simulators.{self.engine}", *(type(effect).__module__ for effect in self.effects))

    def with_registers(self, registers: ServoRegisters) -> "SourceModel":
        """Return the source with the servo registers of a recording."""
        return replace(self, model=registers.set_in(self.robot))

    def simulator(self, dataset: Dataset, threads: int | None = None) -> Simulator:
        """Build the simulator for a dataset's joints and rate; on all cores if `threads` is None."""
        return load_simulator(self.model, 1 / dataset.fps, dataset.joints, self.effects, self.engine, threads)


def find_source(
    model: str | None,
    effects: Sequence[Effect],
    dataset: Dataset,
    kept_in: Sequence[Path],
    engine: str | None = None,
) -> Simulator:
    """Return the source for a dataset: the given model, else the one stored with the data; see `locate_source`."""
    return locate_source(model, effects, kept_in, engine).simulator(dataset)


def locate_source(
    model: str | None, effects: Sequence[Effect], kept_in: Sequence[Path], engine: str | None = None
) -> SourceModel:
    """Return the specification of a dataset's source.

    Args:
        model: A robot's name or a model file, as given by `--model`.
        effects: Effects to add to the given model.
        kept_in: Folders of the dataset and the checkpoint, where a source may be stored.
        engine: `mujoco` or `bullet`; None for the engine of a stored source, and MuJoCo for a given model.

    Raises:
        ModelFileError: no model was given and none is stored.
    """
    if model is not None:
        return SourceModel(model, tuple(effects), engine or ENGINES[0])
    for root in kept_in:
        for folder in (root / "meta", root):
            if (folder / MODEL).is_file():
                kept = read_effects(folder / EFFECTS) if (folder / EFFECTS).is_file() else ()
                return SourceModel(folder / MODEL, tuple(kept), engine or read_kept_engine(root))
    raise ModelFileError(f"No source model is stored in {kept_in[0]}; give one with --model MODEL.xml.")
