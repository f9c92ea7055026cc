"""Exceptions; each message states what was wrong, with the value, and what would be right."""

from collections.abc import Iterable


class NasError(Exception):
    """Base of all errors that a user can cause; the program prints the message and exits with code 2."""

    def __str__(self) -> str:
        """Return the message unquoted, unlike KeyError."""
        return " ".join(str(argument) for argument in self.args)


class DatasetNotFound(NasError, FileNotFoundError):
    """There is no dataset at the path."""


class DatasetInvalid(NasError, ValueError):
    """A dataset is half-written, damaged or breaks the contract."""


class VideosMissing(DatasetInvalid):
    """Video files of a dataset are missing."""


class JointMismatch(NasError, ValueError):
    """Two things that must share joints (dataset, model, checkpoint, command file) do not."""


class ModelFileError(NasError, ValueError):
    """A file given as a robot model cannot be used as one."""


class MapError(NasError, ValueError):
    """A mapping file is malformed or names something that the log lacks."""


class LogError(NasError, ValueError):
    """A recorded log cannot be imported as it is."""


class CheckpointError(NasError, ValueError):
    """A checkpoint is missing, damaged or does not fit."""


class OutputExists(NasError, FileExistsError):
    """A result would overwrite something that exists."""


class BeingWritten(NasError, BlockingIOError):
    """Another program is writing the same result."""


class CannotWrite(NasError, OSError):
    """An output path is not writable."""


class OptionError(NasError, ValueError):
    """A value given by the user is out of its range."""


class MissingPackage(NasError, ImportError):
    """An optional package that this command needs is not installed."""


class SimulationDiverged(NasError, ArithmeticError):
    """A physics or learned simulation diverged."""


class WorkerLost(NasError, RuntimeError):
    """A worker process died before its work was done."""


class JobsFailed(NasError, RuntimeError):
    """Some of many independent jobs failed; the others are done."""


class UnknownName(NasError, LookupError):
    """A name (robot, effect, excitation, dynamics …) that is not in its registry."""

    def __init__(self, kind: str, name: str, choices: Iterable[str], otherwise: str = "") -> None:
        remedies = "; ".join(filter(None, [f"choose one of: {', '.join(sorted(choices))}", otherwise]))
        super().__init__(f"There is no {kind} '{name}'; {remedies}.")

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the message, because the constructor takes other arguments."""
        return UnknownName.__new__, (UnknownName, *self.args)


class PluginInvalid(NasError, AttributeError):
    """A file of a plug-in folder that does not define what its folder asks for."""


class ArmError(NasError, RuntimeError):
    """Base of errors of servos, bus or power supply."""


class NoSuchPort(ArmError, FileNotFoundError):
    """There is no port of that name."""


class PortDenied(ArmError, PermissionError):
    """The user may not open the port."""


class PortBusy(ArmError):
    """Another program has the port."""


class AdapterLost(ArmError):
    """The USB adapter was disconnected while in use."""


class NobodyAnswers(ArmError):
    """No servo answers at all."""


class ServoSilent(ArmError):
    """An expected servo does not answer."""


class BadReply(ArmError):
    """A servo's replies are unreliable."""


class WrongModel(ArmError):
    """A servo is of another model series."""


class DuplicateId(ArmError):
    """Two servos have the same ID."""


class OutsideLimits(ArmError):
    """A joint is outside its limits."""


class PathBlocked(ArmError):
    """No slow path to a pose avoids contact with the arm itself, the floor or another arm."""


class GuardLost(ArmError):
    """The watchdog process that switches the torque off in an emergency has died."""


class SupplyLow(ArmError):
    """The supply voltage is too low."""


class ServoOverloaded(ArmError):
    """A servo shut down after a stall."""


class ServoHot(ArmError):
    """A servo is too hot."""


class ServoRefused(ArmError):
    """A servo answered an instruction with an error."""
