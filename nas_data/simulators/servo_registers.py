"""Servo registers that a recording holds, as changes of the model: what is known is not inferred."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from nas_data.count_of import join_items
from nas_data.dataset.dataset import Dataset
from nas_data.dataset.position_gains import P_GAIN_COLUMN, list_position_gains, read_position_gains
from nas_data.dataset.provenance import Provenance, read_provenance
from nas_data.dataset.supply_voltage import read_supply_voltages
from nas_data.dataset.target_episodes import find_joints, read_history
from nas_data.effects.edits.explicit_values import make_values_explicit
from nas_data.errors import ModelFileError
from nas_data.robots.base import ConsecutiveEdits, Robot
from nas_data.simulators.register_changes import Setting
from nas_data.simulators.register_kinds import KINDS, P_GAIN, SUPPLY, TORQUE, RegisterKind

Values = Mapping[str, Mapping[str, float]]  # by register and joint


@dataclass(frozen=True)
class ServoRegisters:
    """Registers of the servos during a recording.

    Attributes:
        values: Value by register (`KINDS`) and joint.
        changing: Registers that differ between episodes; they have no value.
    """

    values: Values = field(default_factory=dict)
    changing: tuple[str, ...] = ()

    @classmethod
    def of(cls, dataset: Dataset, root: Path | None = None) -> "ServoRegisters":
        """Return the registers of a recording: those of its provenance, and what its frames hold.

        Frames may hold position gains, which count where the torque is on, and the measured supply voltage, whose mean
        is taken.

        Args:
            dataset: The recording.
            root: Its folder, for a dataset without an origin.
        """
        provenance = dataset.origin.provenance if dataset.origin else read_provenance(root) if root else None
        registers = cls.read(provenance, dataset.joints)
        if volts := read_supply_voltages(dataset):
            registers = replace(registers, values={**registers.values, SUPPLY: volts})
        if P_GAIN_COLUMN not in dataset.columns or not dataset.n_frames:
            return registers
        registers, gains = registers.without(P_GAIN), list_position_gains(dataset)
        if len(gains) > 1:
            return replace(registers, changing=(*registers.changing, P_GAIN))
        return replace(registers, values={**registers.values, **_by_joint(dataset, gains)})

    @classmethod
    def read(cls, provenance: Provenance | None, joints: Sequence[str]) -> "ServoRegisters":
        """Return the registers of a recording's joints from its provenance; empty if it holds none."""
        history = read_history((provenance.target if provenance else None) or {})
        entries = [_normalise(tables, joints) for _, tables in history]
        first, *others = entries or [{}]
        changing = tuple(name for name in KINDS if any(other.get(name) != first.get(name) for other in others))
        return cls({name: values for name, values in first.items() if name not in changing}, changing)

    def over(self, others: "ServoRegisters") -> "ServoRegisters":
        """Return these registers, and others where these say nothing."""
        more = {name: values for name, values in others.values.items() if name not in self.changing}
        names = {**more, **self.values}
        return ServoRegisters(
            {name: {**more.get(name, {}), **self.values.get(name, {})} for name in names}, self.changing
        )

    def without(self, register: str) -> "ServoRegisters":
        """Return the registers without one that the recording holds in another way."""
        values = {name: values for name, values in self.values.items() if name != register}
        return ServoRegisters(values, tuple(name for name in self.changing if name != register))

    def set_in(self, robot: Robot) -> Robot:
        """Return a robot whose model has these registers, as far as they can be set.

        The new model states these registers, so that a second call changes nothing.

        Raises:
            ModelFileError: the model states a value that a register cannot have.
        """
        stated = self.select_stated(robot)
        if not stated.values:
            return robot
        return replace(robot, edit=ConsecutiveEdits(robot.edit, RegisterEdit(stated, robot)))

    def list_changes(self, robot: Robot) -> list[str]:
        """Return what `set_in` changes in a robot's model, as phrases."""
        changes: dict[str, list[str]] = {}
        for use in self._examine(robot):
            if use.is_change:
                changes.setdefault(use.describe(), []).append(use.setting.joint)
        return [f"{text} in {', '.join(its)}" for text, its in changes.items()]

    def describe(self, robot: Robot) -> tuple[str, ...]:
        """Return sentences: what `set_in` changes in a robot's model, and which registers it cannot use."""
        refused: dict[tuple[str, str], list[str]] = {}
        unknown: dict[str, None] = {}
        for use in self._examine(robot):
            if use.obstacle:
                refused.setdefault((use.kind.name, use.obstacle), []).append(use.setting.joint)
            elif use.is_unknown and not use.kind.is_measured:
                unknown[use.kind.name] = None
        sentences = [f"As the recording's registers say, {change}." for change in self.list_changes(robot)]
        if unknown:
            sentences.append(
                f"The recording's registers {join_items(list(unknown))} are not used, because the model does not state "
                f'those of its own: add <custom><numeric name="{next(iter(unknown))}" data="…"/></custom> to it.'
            )
        sentences += [
            f"The recording's register {name} is not used in {', '.join(its)}, because {reason}."
            for (name, reason), its in refused.items()
        ]
        if self.changing:
            sentences.append(
                f"The recording's registers {join_items(self.changing)} differ between episodes, or are not known in "
                "all, and are not used: record each setting by itself."
            )
        return tuple(sentences)

    def select_stated(self, robot: Robot) -> "ServoRegisters":
        """Return the registers that a robot's model has once they are set; it then states them.

        They are those that it states with these values, and those that change it.
        """
        found = dict[str, dict[str, float]]()
        for use in self._examine(robot):
            if use.is_stated or use.is_change:
                found.setdefault(use.kind.name, {})[use.setting.joint] = use.setting.value
        return ServoRegisters(found)

    def _examine(self, robot: Robot) -> Iterator["RegisterUse"]:
        """Yield what each register does in a robot's model."""
        if not self.values:
            return
        spec = robot.spec()
        make_values_explicit(spec)
        for kind, joint, value in self:
            if spec.joint(joint) is not None:
                yield RegisterUse(kind, make_setting(spec, robot, kind, (joint, value)))

    def __iter__(self) -> Iterator[tuple[RegisterKind, str, float]]:
        """Yield register, joint and value, in the order in which they change a model."""
        for name, kind in KINDS.items():
            for joint, value in self.values.get(name, {}).items():
                yield kind, joint, value


NO_REGISTERS = ServoRegisters()


def group_by_registers(dataset: Dataset, volts: Mapping[str, float]) -> Iterator[tuple[list[int], ServoRegisters]]:
    """Yield the places of the episodes with each setting of the servos, and their registers.

    Args:
        dataset: Episodes.
        volts: Supply voltage of each joint's servo [V], the same for all of them; empty if unknown.

    Raises:
        DatasetInvalid: a position gain changes within an episode.
    """
    history = read_history((dataset.origin.provenance.target if dataset.origin else None) or {})
    gains = read_position_gains(dataset) if P_GAIN_COLUMN in dataset.columns else None
    groups: list[tuple[ServoRegisters, list[int]]] = []
    for place in range(dataset.n_episodes):
        values = _normalise(find_joints(history, place), dataset.joints) if history else {}
        if gains is not None:
            values = {**values, **_by_joint(dataset, gains[[place]])}
        registers = ServoRegisters({**values, **({SUPPLY: dict(volts)} if volts else {})})
        known = next((places for other, places in groups if other == registers), None)
        if known is None:
            groups.append((registers, [place]))
        else:
            known.append(place)
    yield from ((places, registers) for registers, places in groups)


def _by_joint(dataset: Dataset, gains: np.ndarray) -> dict[str, dict[str, float]]:
    """Return the register of the position gain from its only row (1, n); empty without one, or if it is 0."""
    return {P_GAIN: dict(zip(dataset.joints, gains[0].tolist(), strict=True))} if gains.any() else {}


@dataclass(frozen=True)
class RegisterUse:
    """What a register of a recording does in a model.

    Attributes:
        kind: Register.
        setting: Its value and the model.
    """

    kind: RegisterKind
    setting: Setting

    @property
    def is_stated(self) -> bool:
        """Whether the model states this value."""
        return self.setting.own == self.setting.value

    @property
    def is_idle(self) -> bool:
        """Whether the register switches off what the model lacks."""
        change, setting = self.kind.change, self.setting
        return setting.own is None and change.is_none(setting) and not change.is_in(setting.spec, setting.joint)

    @property
    def obstacle(self) -> str:
        """Why the register cannot be set, as the end of a sentence; empty if nothing is to be set, or it can be."""
        if self.is_stated or self.is_idle:
            return ""
        setting, change = self.setting, self.kind.change
        if setting.own is None and not change.is_relative and change.is_in(setting.spec, setting.joint):
            return (
                f"the model has a {self.kind.words} of its own: state the register for which it holds, "
                f'<custom><numeric name="{self.kind.name}" data="…"/></custom>'
            )
        return change.find_obstacle(setting)

    @property
    def is_unknown(self) -> bool:
        """Whether the register is relative to one that the model does not state."""
        return self.kind.change.is_relative and self.setting.own is None and not self.is_idle

    @property
    def is_change(self) -> bool:
        """Whether the register changes the model."""
        return not (self.is_stated or self.is_idle or self.is_unknown or self.obstacle)

    def describe(self) -> str:
        """Return a phrase for the change."""
        setting = self.setting
        own = "" if setting.own is None else f", in the model {setting.own:g}"
        return f"{self.kind.change.describe(setting)} ({self.kind.name} {setting.value:g}{own})"


@dataclass(frozen=True)
class RegisterEdit:
    """A model edit that sets registers.

    Attributes:
        registers: Registers that the model can have.
        robot: Robot of the model before the edit.
    """

    registers: ServoRegisters
    robot: Robot

    def __call__(self, spec: mujoco.MjSpec) -> None:
        """Edit a model."""
        make_values_explicit(spec)
        for kind, joint, value in self.registers:
            setting = make_setting(spec, self.robot, kind, (joint, value))
            if value != setting.own:
                kind.change.edit(setting)
            state(spec, kind.name, joint, value)


def make_setting(spec: mujoco.MjSpec, robot: Robot, kind: RegisterKind, wanted: tuple[str, float]) -> Setting:
    """Return a register's value in a joint (`wanted`) together with those for which the model holds."""
    joint, value = wanted
    own, limit = (read_stated(spec, robot, name, joint) for name in (kind.name, TORQUE))
    return Setting(spec, joint, value, own, limit)


def read_stated(spec: mujoco.MjSpec, robot: Robot, register: str, joint: str) -> float | None:
    """Return the value of a joint's register for which a model holds; None if neither model nor robot states it.

    Raises:
        ModelFileError: the model states a value that the register cannot have.
    """
    if spec.joint(joint) is None:
        return None
    found = (spec.numeric(f"{joint}_{register}"), spec.numeric(register))
    number = next((each for each in found if each is not None), None)
    if number is None:
        return dict(robot.registers).get(register)
    value, kind = float(number.data[0]), KINDS[register]
    if not 0 <= value < math.inf or (kind.is_positive and not value):
        least = "is above 0" if kind.is_positive else "is at least 0"
        raise ModelFileError(f"{robot.mjcf} gives the numeric '{number.name}' as {value:g}; a {kind.words} {least}.")
    return value


def state(spec: mujoco.MjSpec, register: str, joint: str, value: float) -> None:
    """State in a model the value of a joint's register for which it holds."""
    name = f"{joint}_{register}"
    number = spec.numeric(name) or spec.add_numeric(name=name, size=1, data=[0.0])
    number.data = [value]


def _normalise(tables: Mapping[str, Mapping[str, float]], joints: Iterable[str]) -> dict[str, dict[str, float]]:
    """Return the registers of control tables by their common names; those that are no settings are left out."""
    found: dict[str, dict[str, float]] = {}
    for joint in joints:
        table = {name: float(value) for name, value in tables.get(joint, {}).items()}
        for name, kind in KINDS.items():
            value = kind.read(table)
            if value is not None and (value > 0 or not kind.is_positive):
                found.setdefault(name, {})[joint] = value
    return found
