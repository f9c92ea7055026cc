"""Inspect an ErgoJr on a port: its servos and their state; calibrate, rename or reboot them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from nas_data.commands.base import Command, CommandResult
from nas_data.errors import OptionError
from nas_data.text_table import align_columns

if TYPE_CHECKING:
    from nas_data.hardware.xl320.arm import Xl320Arm
    from nas_data.hardware.xl320.inventory import Inventory
    from nas_data.hardware.xl320.survey import FoundServo

NAME = "ergojr"


@dataclass(frozen=True, kw_only=True)
class RobotErgojr(Command):
    """Show the servos that answer on a port, and faults that prevent the arm's use.

    Exit code: 0 if the arm is ready, 1 if not, 2 if nothing answers. Nothing moves, and the torque is not changed. To
    calibrate, put the arm into its zero pose by hand first: all marks of the horns in line.

    Example: nas robot ergojr --port virtual
    """

    port: str
    """Serial port of the adapter, for example the one of a U2D2; 'virtual' for a simulated arm."""
    calibrate: bool = False
    """Take the present pose as zero and store it in LeRobot's folder, or in --calibration."""
    calibration: Path | None = None
    """Calibration file; LeRobot's by default, which a virtual arm neither reads nor writes."""
    id: str = NAME
    """Name of this arm: LeRobot's robot id, which selects its calibration file."""
    reboot: bool = False
    """Restart every servo first, which clears an overload or overheating; a raised arm falls."""
    rename: str | None = None
    """Change a servo's ID, given as OLD:NEW; only one servo may have the ID OLD."""
    effect: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """An effect of the virtual arm, NAME:joint=JOINT,PARAMETER=NUMBER; may be given several times."""
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A fault of the virtual arm, NAME:PARAMETER=NUMBER, for example unplugged:servo=3; may be given several times."""

    def run(self) -> CommandResult:
        """Inspect the arm, and carry out the options."""
        from nas_data.hardware.virtual_bus.process import VIRTUAL, port_of
        from nas_data.hardware.xl320.arm import Xl320Arm
        from nas_data.hardware.xl320.joints import default_path, find_joints, make_ergojr_joints

        path = self.calibration or (None if self.port == VIRTUAL else default_path(NAME, self.id))
        joints = make_ergojr_joints()
        if self.calibrate and path is None:
            raise OptionError(
                "The zeros of a virtual arm must not replace those of your arm; give another file for them: "
                "--calibration FILE."
            )
        if path and not self.calibrate:
            joints = find_joints(joints, NAME, self.id, self.calibration)
        with port_of(self.port, self.effect, self.fault) as port:
            arm = Xl320Arm(port, joints)
            try:
                return self._inspect(arm, path)
            finally:
                arm.close()

    def _inspect(self, arm: "Xl320Arm", path: Path | None) -> CommandResult:
        from nas_data.hardware.xl320.inventory import take_inventory

        if self.rename:
            self._rename(arm, self.rename)
        if self.reboot:
            for identity in arm.joints.ids:
                arm.bus.reboot(identity)
        inventory = take_inventory(arm)
        lines = [*format_servos(inventory.servos, arm), *(f"problem: {problem}" for problem in inventory.problems)]
        ready = not inventory.problems
        if self.calibrate and path:
            lines.append(self._calibrate(arm, path))
        elif ready:
            lines.append(
                f"The arm is ready. Zeros: {path if path and path.is_file() else 'not calibrated (--calibrate)'}"
            )
        return CommandResult("\n".join(lines), make_json(inventory, arm), ready)

    def _calibrate(self, arm: "Xl320Arm", path: Path) -> str:
        """Store the present pose as zero."""
        import numpy as np

        from nas_data.hardware.xl320.joints import compute_zero_offsets, write_calibration

        raw = np.array([arm.bus.get(identity, "present_position") for identity in arm.joints.ids])
        joints = arm.joints.with_offsets(compute_zero_offsets(arm.joints, raw))
        write_calibration(path, joints)
        return f"Zero offsets {', '.join(map(str, joints.offsets))} ticks → {path}"

    def _rename(self, arm: "Xl320Arm", text: str) -> None:
        """Change the ID of one servo."""
        from nas_data.hardware.xl320.survey import refuse_duplicates

        old, _, new = text.partition(":")
        if not (old.isdecimal() and new.isdecimal() and int(old) <= 252 and int(new) <= 252):
            raise OptionError(f"--rename is '{text}'; write OLD:NEW with IDs in 0 … 252.")
        if arm.bus.ping(int(new)):
            raise OptionError(f"A servo with ID {new} already answers; unplug it, or choose another ID.")
        refuse_duplicates(arm.bus, [int(old)])
        arm.bus.rename(int(old), int(new))


def format_servos(servos: "Sequence[FoundServo]", arm: "Xl320Arm") -> list[str]:
    """Return a table of the servos found; positions in degrees."""
    heading = ("joint", "id", "model", "firmware", "supply", "warmth", "position", "torque", "errors")
    return align_columns([heading, *(make_servo_row(servo, arm) for servo in servos)], left=(0, len(heading) - 1))


def make_servo_row(servo: "FoundServo", arm: "Xl320Arm") -> tuple[str, ...]:
    """Return the cells of one servo."""
    import numpy as np

    joint, angle = "?", ""
    if servo.id in arm.joints.ids:
        place = arm.joints.ids.index(servo.id)
        joint = arm.joints.names[place]
        angle = f"{np.degrees(arm.joints.positions(np.full(len(arm.joints.ids), servo.ticks))[place]):.1f}°"
    return (
        joint,
        str(servo.id),
        str(servo.model),
        str(servo.firmware),
        f"{servo.voltage:.1f} V",
        f"{servo.temperature} °C",
        angle,
        "on" if servo.torque else "off",
        ", ".join(servo.errors) or "–",
    )


def make_json(inventory: "Inventory", arm: "Xl320Arm") -> dict[str, object]:
    """Return the inventory for JSON."""
    return {
        "port": arm.port,
        "servos": [vars(servo) for servo in inventory.servos],
        "problems": list(inventory.problems),
    }
