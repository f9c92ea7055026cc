"""The one family of errors: each says what was wrong, with the value, and what would be right."""

from collections.abc import Iterable


class NasError(Exception):
    """Base of every error a user can cause; the program prints its sentence and exits with code 2."""

    def __str__(self) -> str:
        """Return the sentence as it was given (KeyError would quote it)."""
        return " ".join(str(argument) for argument in self.args)


class DatasetNotFound(NasError, FileNotFoundError):
    """There is no dataset at the path."""


class DatasetInvalid(NasError, ValueError):
    """A dataset is half-written, damaged or breaks the contract."""


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
    """A result cannot be written where it should lie."""


class OptionError(NasError, ValueError):
    """A value given by the user is out of its range."""


class MissingPackage(NasError, ImportError):
    """An optional package that this command needs is not installed."""


class SimulationDiverged(NasError, ArithmeticError):
    """A simulation, plain or learned, left all bounds."""


class WorkerLost(NasError, RuntimeError):
    """A worker process ended before its work was done."""


class JobsFailed(NasError, RuntimeError):
    """Several of many independent jobs could not be done; the others are."""


class UnknownName(NasError, LookupError):
    """A name (robot, effect, excitation, dynamics …) that is not in its registry."""

    def __init__(self, kind: str, name: str, choices: Iterable[str]) -> None:
        super().__init__(f"There is no {kind} '{name}'; choose one of: {', '.join(sorted(choices))}.")

    def __reduce__(self) -> tuple[object, ...]:
        """Return how it crosses to another process: as its sentence, which is made."""
        return UnknownName.__new__, (UnknownName, *self.args)


class ArmError(NasError, RuntimeError):
    """Base of what goes wrong with servos, their line or their supply."""


class NoSuchPort(ArmError, FileNotFoundError):
    """There is no port of that name."""


class PortDenied(ArmError, PermissionError):
    """The user may not open the port."""


class PortBusy(ArmError):
    """Another program has the port."""


class AdapterLost(ArmError):
    """The adapter was pulled out while it was used."""


class NobodyAnswers(ArmError):
    """No servo answers at all."""


class ServoSilent(ArmError):
    """A servo that should be there does not answer."""


class BadReply(ArmError):
    """What a servo answers cannot be trusted."""


class WrongModel(ArmError):
    """A servo is of another series."""


class DuplicateId(ArmError):
    """Two servos have one identity."""


class OutsideLimits(ArmError):
    """A joint stands where it must not be."""


class PathBlocked(ArmError):
    """The arm would touch itself, the floor or another arm on every slow path to a pose."""


class GuardLost(ArmError):
    """The process that switches the torque off in an emergency is gone."""


class SupplyLow(ArmError):
    """The supply gives too little voltage."""


class ServoOverloaded(ArmError):
    """A servo shut down because it was stalled."""


class ServoHot(ArmError):
    """A servo is too hot."""


class ServoRefused(ArmError):
    """A servo answered an instruction with an error."""
