"""Pairing of a dataset with the predictions of a source model."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nas_data.api.arguments import Actuators, as_correction, as_dataset, as_model
from nas_data.count_of import count_of, join_items
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.origin import Origin
from nas_data.dataset.provenance import format_current_time, read_package_versions
from nas_data.dataset.torque_off import TORQUE, find_torque_off, find_torque_on
from nas_data.effects.base import Effect, parse
from nas_data.errors import NasError
from nas_data.gap.report import GapReport
from nas_data.log import warn
from nas_data.pairing import describe_missing_objects, warn_of_overlaps, warn_of_ranges
from nas_data.pairing import pair as pair_with
from nas_data.robots.base import Robot, find_robot
from nas_data.simulators.engines import MUJOCO, load_simulator
from nas_data.simulators.servo_registers import ServoRegisters
from nas_data.sources import check_kept, collect_source_files, describe_left_out


@dataclass(frozen=True, kw_only=True)
class PairingSource:
    """Arguments of `pair` that define the source."""

    model: str | Path
    engine: str = "mujoco"
    effects: Sequence[Effect | str] = ()
    report: GapReport | str | Path | None = None
    actuators: Actuators = "position"


@dataclass(frozen=True)
class Pairing:
    """A paired dataset, with details of the pairing.

    Attributes:
        dataset: Dataset with `next.observation.sim_state`.
        source: Source, as in provenance.
        seconds: Duration of the simulation [s].
        warnings: Warnings, one sentence each; already shown on stderr.
        remarks: Registers of the recording that the source does not have, and parts of it that could not be stored.
    """

    dataset: Dataset
    source: Mapping[str, object]
    seconds: float
    warnings: tuple[str, ...]
    remarks: tuple[str, ...]


def pair(
    dataset: Dataset | str | Path,
    model: str | Path,
    *,
    engine: str = "mujoco",
    effects: Sequence[Effect | str] = (),
    report: GapReport | str | Path | None = None,
    actuators: Actuators = "position",
) -> Dataset:
    """Add a source's prediction of every transition: reset to the state before it, command held for one step.

    Args:
        dataset: N transitions, or their folder.
        model: Source: an MJCF or URDF file with the dataset's joint names, or a robot's name.
        engine: `mujoco` or `bullet`.
        effects: Effects to add to the source, for example `"backlash:joint=m3,half_width=0.02"`.
        report: A gap report, or its folder, whose effects and retuned parameters are added to the source.
        actuators: Actuators for a URDF: `position` servos, or motors (`torque`).

    Returns:
        The dataset with `next.observation.sim_state`: positions [rad; m] then velocities [rad/s; m/s], shape (N, 2n).
        The source is stored with it: `save` writes both.

    Raises:
        JointMismatch: model and dataset have other joints or command types.
        ModelFileError, OptionError, UnknownName: model, effects or engine cannot be used.
    """
    source = PairingSource(model=model, engine=engine, effects=effects, report=report, actuators=actuators)
    return make_pairs(as_dataset(dataset), source).dataset


def make_pairs(recorded: Dataset, by: PairingSource) -> Pairing:
    """Pair as `pair`, and return details.

    Args:
        recorded: N transitions, as `as_dataset` returns them.
        by: The source.
    """
    named = None if by.report is None else as_correction(by.report)
    added = [parse(effect) if isinstance(effect, str) else effect for effect in by.effects]
    added += named.effects if named else ()
    model = as_model(by.model, by.actuators)
    plain = find_robot(model)
    robot = named.robot(plain, recorded.joints) if named else plain
    simulator = load_simulator(robot, 1 / recorded.fps, recorded.joints, tuple(added), by.engine)
    began = time.perf_counter()
    paired = pair_with(recorded, simulator)
    seconds = time.perf_counter() - began
    missing = describe_missing_objects(recorded, simulator)
    warnings = [*warn_of_ranges(recorded, robot), *warn_of_overlaps(recorded, simulator), *missing]
    warn(missing)
    files, remark = keep_source(robot, added, paired, by.engine, model)
    known = describe_other_registers(recorded, robot), describe_powered_rows(recorded, by.engine), remark
    remarks = tuple(filter(None, known))
    origin, source = recorded.origin, simulator.describe()
    assert origin is not None
    made = {
        "how": "paired",
        "when": format_current_time(),
        "packages": dict(read_package_versions()),
        "content_hash": "",
        "files": {},
    }
    provenance = replace(origin.provenance, **made, source=source, parents=origin.parents)  # type: ignore[arg-type]
    kept = {f"meta/{name}": content for name, content in files.items()}
    paired = replace(paired, origin=None)
    paired = replace(paired, origin=Origin(paired, provenance, origin.derived, attachments=kept))
    return Pairing(paired, source, seconds, (*origin.noticed, *warnings), remarks)


def describe_other_registers(recorded: Dataset, robot: Robot) -> str | None:
    """Return a remark on the servo registers of a recording that a source does not have; None if it has all."""
    registers = ServoRegisters.of(recorded)
    remarks = []
    if changes := registers.list_changes(robot):
        remarks.append(
            f"the source is paired as given, not as the recording's registers say ({'; '.join(changes)}): φ then "
            "learns this difference"
        )
    if registers.changing:
        remarks.append(
            "the source is paired as given, although the recording's registers "
            f"{join_items(registers.changing)} differ between episodes: φ cannot tell them apart; train it on the "
            "episodes of one setting (--episodes)"
        )
    return "; ".join(remarks) or None


def describe_powered_rows(recorded: Dataset, engine: str) -> str | None:
    """Return a remark on rows that are predicted with torque where the recording has none at some servo."""
    without = ~find_torque_on(recorded)
    if engine == MUJOCO:
        without &= ~find_torque_off(recorded)
    count = int(without.sum())
    return f"{count_of(count, 'row')} without torque at some servo ({TORQUE}) predicted with torque" if count else None


def keep_source(
    robot: Robot, effects: Sequence[Effect], paired: Dataset, engine: str, model: str
) -> tuple[Mapping[str, bytes], str | None]:
    """Return the source's files to store with the dataset, and what they lack; no files if they predict differently."""
    files, remark = collect_source_files(robot, effects), describe_left_out(robot)
    if remark is None:
        return files, None
    try:
        check_kept(files, paired, engine)
    except NasError:
        return {}, (
            "the source is not stored with the dataset: its meshes collide in these motions, and their files cannot "
            f"be stored with it; give --model {model} to later commands"
        )
    return files, remark
