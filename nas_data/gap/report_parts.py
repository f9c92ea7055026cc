"""Parts of a gap report beside its effects: typed records of errors, joints, conditions and experiments."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.gap.report_effects import OPTIONAL
from nas_data.joint_units import HINGE
from nas_data.typed_json import as_object

LARGE_FACTOR = 1.251  # the bound of ±25 %, `nominal_parameters.MAX_LOG_CHANGE`, and the rounding of a report's factors

LESS_BASELINE = ", less the errors of the baseline"  # end of the metric if they are subtracted


@dataclass(frozen=True, kw_only=True)
class Retuned:
    """A parameter of the model that was changed.

    Attributes:
        parameter: Joint and kind, for example `m2.damping`.
        factor: New value over the model's.
        at_bound: Whether the fit ended on the bound of ±25 %.
    """

    parameter: str
    factor: float
    at_bound: bool = False

    @property
    def joint(self) -> str:
        """Joint of the parameter."""
        return self.parameter.rpartition(".")[0]

    @property
    def is_large(self) -> bool:
        """Whether it changed by more than a parameter's tolerance, which only freed parameters can."""
        return self.factor > LARGE_FACTOR or self.factor * LARGE_FACTOR < 1


@dataclass(frozen=True, kw_only=True)
class JointDescription:
    """Completeness of a joint's description.

    Attributes:
        complete: Confidence that no effect is missing.
        ratio_to_noise: Held-out error over the noise floor.
        stable: Whether two halves of the recording agree on its parameters; None if it cannot be divided.
    """

    complete: float
    ratio_to_noise: float
    stable: bool | None


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """A joint whose gap has no name.

    Attributes:
        joint: Name of the joint.
        ratio_to_noise: Remaining error over the noise floor.
        goes_with: Quantity that the error correlates with, or `nothing`; where the error is at the floor, the
            parameter whose large change takes it there, for example `m2.frictionloss`.
    """

    joint: str
    ratio_to_noise: float
    goes_with: str

    @property
    def is_at_floor(self) -> bool:
        """Whether a large change of a parameter takes the error to the floor."""
        return self.goes_with.startswith(f"{self.joint}.")


@dataclass(frozen=True, kw_only=True)
class GapErrors:
    """Held-out open-loop RMSE of positions over joints of one kind, in `unit`: rad, or m for slides.

    Attributes:
        noise_floor: Noise floor of the readings.
        before: Given model.
        plain: Plain fit: every smooth parameter fitted, no effects named.
        after: Named effects.
        after_model_xml: `model.xml` alone, if it cannot express all effects.
    """

    unit: str = HINGE.si
    noise_floor: float | None = field(default=None, metadata=OPTIONAL)
    before: float
    plain: float | None = field(default=None, metadata=OPTIONAL)
    after: float
    after_model_xml: float | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True, repr=False)
class ArmGap(GapErrors):
    """The gap of the whole arm: errors over its hinges, or over its slides without hinges.

    Attributes:
        metric: Definition of the errors.
        delivered: Content of `model.xml`: `names`, `names and plain`, `names of MJCF and plain`, `plain` or `given`.
        slides: Errors over the slides of an arm that has hinges as well.
        per_joint: Errors of each joint.
        conditioning: The same as the report's own.
    """

    metric: str = ""
    delivered: str | None = field(default=None, metadata=OPTIONAL)
    slides: GapErrors | None = field(default=None, metadata=OPTIONAL)
    per_joint: Mapping[str, GapErrors] = field(default_factory=dict)
    conditioning: float | None = field(default=None, metadata=OPTIONAL)

    @property
    def less(self) -> str:
        """What is subtracted from the errors, as the end of a phrase; empty for nothing."""
        return LESS_BASELINE if self.metric.endswith(LESS_BASELINE) else ""

    def __repr__(self) -> str:
        """Return the errors before and after."""
        return f"ArmGap({self.before:.3g} → {self.after:.3g} {self.unit}, {len(self.per_joint)} joints)"


@dataclass(frozen=True, kw_only=True)
class Shares:
    """Shares of the squared gap above the noise: explained by names, learned by φ in addition, and left."""

    names: float | None
    learned: float | None = None
    left: float | None


@dataclass(frozen=True, kw_only=True)
class LearnedCorrection:
    """Open-loop RMSE over whole held-out episodes without and with φ; φ is delivered only if it reduces it.

    Attributes:
        given: RMSE of the given model, in `unit`.
        written: RMSE of the written model, which φ corrects.
        corrected: RMSE with φ; None if it diverges.
        unit: `rad`, `m` for an arm of slides, or `1` for errors over the spread of hinges and slides.
    """

    given: float
    written: float
    corrected: float | None = None
    unit: str = HINGE.si

    @property
    def helps(self) -> bool:
        """Whether φ reduces the error of the written model."""
        return self.corrected is not None and self.corrected < self.written

    @property
    def shares(self) -> Shares:
        """Shares of the squared error of the given model; without φ if it is left out."""
        before, after = max(self.given**2, 1e-18), self.written**2
        if self.corrected is None or not self.helps:
            return Shares(names=1 - after / before, left=after / before)
        left = self.corrected**2
        return Shares(names=1 - after / before, learned=(after - left) / before, left=left / before)


@dataclass(frozen=True, kw_only=True)
class JointGap:
    """RMS position errors of one joint with the given model, in `unit`.

    Attributes:
        floor: Noise floor of the readings.
        one_step: Model, reset to each measured state.
        one_step_hold: Hold: the position stays.
        open_loop: Model, started once per episode.
        open_loop_hold: Hold: the initial pose stays.
        open_loop_command: Command as prediction; None for torques.
        ratio_to_noise: `open_loop` over `floor`.
        repeatability: Standard deviation between repeats of the same commands; None without repeats.
        unit: `rad`, or `m` for a slide.
    """

    floor: float
    one_step: float
    one_step_hold: float
    open_loop: float
    open_loop_hold: float
    open_loop_command: float | None
    ratio_to_noise: float
    repeatability: float | None = None
    unit: str = HINGE.si


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Error of one joint under one condition [rad; slides m].

    Attributes:
        joint: Name of the joint.
        regime: Name of the condition.
        bin: Name of the bin.
        rows: Number of rows in the bin.
        rmse: RMS error in the bin.
        mean: Mean error, model minus measured. Opposite signs in the two directions indicate missing friction, play or
            lag.
        rest: RMS error in the condition's other bins.
        ratio_to_noise: `rmse` over the noise floor.
        share: Share of the joint's total squared error.
        chance: p-value of the difference to the rest; 1 for a joint without gap.
        significant: Whether it differs from the rest, corrected for all bins of the arm.
    """

    joint: str
    regime: str
    bin: str
    rows: int = 0
    rmse: float
    mean: float = 0.0
    rest: float
    ratio_to_noise: float
    share: float
    chance: float = 1.0
    significant: bool


@dataclass(frozen=True)
class Check:
    """Result of one audit of the recording.

    Attributes:
        check: Name of the audit.
        finding: Result and its meaning, one or two sentences.
        ok: Whether the recording can be used as it is in this respect.
    """

    check: str
    finding: str
    ok: bool = True


@dataclass(frozen=True, kw_only=True, repr=False)
class GapFindings:
    """Location of the gap.

    Attributes:
        joints: Errors of each joint.
        regimes: Errors of each joint under each condition.
        audit: Results of the audits.
        undecidable: Questions that these data cannot decide, a sentence each.
    """

    joints: Mapping[str, JointGap]
    regimes: tuple[Bin, ...]
    audit: tuple[Check, ...]
    undecidable: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return the error of each joint in noise floors."""
        ratios = ", ".join(f"{joint} {gap.ratio_to_noise:.3g}" for joint, gap in self.joints.items())
        return f"GapFindings({ratios} noise floors)"

    def to_json(self) -> dict[str, object]:
        """Return the content in SI units."""
        return as_object(self)

    def text(self) -> str:
        """Return a summary in degrees and millimetres."""
        from nas_data.gap.finding.text import describe_findings

        return describe_findings(self.joints, self.regimes, self.audit, self.undecidable)


@dataclass(frozen=True, kw_only=True)
class TriedExperiment:
    """An experiment that could be recorded next.

    Attributes:
        name: Kind of commands.
        on: Joints that move.
        seconds: Duration [s].
        separation: Largest difference of the explanation from a rival [noise floors].
        joint: Joint with that difference.
        separations: Difference from each rival [noise floors].
    """

    name: str
    on: tuple[str, ...]
    seconds: float
    separation: float
    joint: str
    separations: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class EpisodeNumbers:
    """Numbers of the fitted and of the held-out episodes.

    Attributes:
        begin_in_motion: Whether held-out episodes begin in motion, so that their initial states are uncertain.
    """

    train: tuple[int, ...]
    heldout: tuple[int, ...]
    begin_in_motion: bool = False


@dataclass(frozen=True, kw_only=True)
class MadeFrom:
    """Input and environment of a report.

    Attributes:
        command: Command that reproduces it.
        content_hash: Content hash of the recording.
        model_sha256: SHA-256 of the given model file.
        versions: Versions of Python and packages, by name.
    """

    command: str
    content_hash: str
    model_sha256: str
    versions: Mapping[str, str]
