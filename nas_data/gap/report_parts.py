"""Parts of a gap report: typed records of effects, errors, joints, conditions and experiments."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.joint_units import HINGE
from nas_data.typed_json import as_object

NAME = {"key": "effect"}
OPTIONAL = {"optional": True}
LARGE_FACTOR = 1.251  # the bound of ±25 %, `nominal_parameters.MAX_LOG_CHANGE`, and the rounding of a report's factors


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """A parameter of an effect.

    Attributes:
        value: Value in `unit`.
        unit: SI unit.
        interval95: 95 % confidence interval if the name is right; None if unknown.
    """

    value: float
    unit: str = ""
    interval95: tuple[float, float] | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True)
class EffectName:
    """An effect by name and joint; joint is None for the whole arm."""

    name: str = field(metadata=NAME)
    joint: str | None = None

    def __str__(self) -> str:
        """Return the name with its joint."""
        return f"{self.name} in {self.joint}" if self.joint else self.name


@dataclass(frozen=True, kw_only=True)
class Alternative(EffectName):
    """An effect that could replace a named one.

    Attributes:
        parameters: Fitted values by name [SI].
        heldout_error_after: Held-out error with it, in the unit of the named effect's evidence.
    """

    parameters: Mapping[str, float] | None = field(default=None, metadata=OPTIONAL)
    heldout_error_after: float


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What a name rests on.

    Attributes:
        heldout_error_before: Held-out open-loop RMSE without the effect, everything else fitted again.
        heldout_error_after: The same with it.
        unit: Unit of both errors: rad, or m for a slide.
        closest_rival: Closeness of the nearest rival: 1 if it predicts as well in every joint, 0 if much worse.
        chosen: Share of random draws of the episodes in which the name is worth its price.
        unexplained: RMS error of its joints above the noise, with the name over without it; more if much remains.
    """

    heldout_error_before: float
    heldout_error_after: float
    unit: str = HINGE.si
    closest_rival: float | None = field(default=None, metadata=OPTIONAL)
    chosen: float | None = field(default=None, metadata=OPTIONAL)
    unexplained: float | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True, repr=False)
class NamedEffect(EffectName):
    """An effect that the model lacks.

    Attributes:
        parameters: Fitted parameters by name.
        confidence: Probability that name and joint are right.
        evidence: Error without and with it, everything else fitted again.
        alternatives: Rivals in its place, best first.
        equals: Rivals that these data cannot distinguish from it.
        in_model_xml: Whether `model.xml` expresses it; `effects.json` always does.
    """

    parameters: Mapping[str, FittedParameter]
    confidence: float
    evidence: Evidence
    alternatives: tuple[Alternative, ...] = ()
    equals: tuple[EffectName, ...] = ()
    in_model_xml: bool = True

    def __repr__(self) -> str:
        """Return name, joint, parameters and confidence in a line."""
        values = ", ".join(f"{name} {one.value:.4g} {one.unit}".strip() for name, one in self.parameters.items())
        return f"NamedEffect({self}: {values}; confidence {self.confidence:.2f})"


@dataclass(frozen=True, kw_only=True)
class FittedEffect(EffectName):
    """An effect with its fitted parameters by name."""

    parameters: Mapping[str, FittedParameter] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Placebo:
    """Runner-up in place of the name with the highest confidence.

    Attributes:
        effects: All effects of that model.
        after: Held-out error, in the unit of the gap.
        text: Replacement in words.
    """

    effects: tuple[FittedEffect, ...]
    after: float
    text: str


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
    def is_large(self) -> bool:
        """Whether it changed by more than a parameter's tolerance, which only freed parameters can."""
        return self.factor > LARGE_FACTOR or self.factor * LARGE_FACTOR < 1


@dataclass(frozen=True, kw_only=True)
class JointDescription:
    """Completeness of a joint's description.

    Attributes:
        complete: Confidence that no effect is missing.
        ratio_to_noise: Held-out error over the noise floor.
        stable: Whether two halves of the recording agree on its parameters.
    """

    complete: float
    ratio_to_noise: float
    stable: bool


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """A joint with an error above the noise floor, and the quantity that it correlates with."""

    joint: str
    ratio_to_noise: float
    goes_with: str


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


@dataclass(frozen=True, kw_only=True)
class ArmGap(GapErrors):
    """The gap of the whole arm: errors over its hinges, or over its slides without hinges.

    Attributes:
        metric: Definition of the errors.
        delivered: Content of `model.xml`: `names`, `names and plain`, `names of MJCF and plain`, `plain` or `given`.
        slides: Errors over the slides of an arm that has hinges as well.
        per_joint: Errors of each joint.
        conditioning: Condition number of the final fit.
    """

    metric: str = ""
    delivered: str | None = field(default=None, metadata=OPTIONAL)
    slides: GapErrors | None = field(default=None, metadata=OPTIONAL)
    per_joint: Mapping[str, GapErrors] = field(default_factory=dict)
    conditioning: float | None = field(default=None, metadata=OPTIONAL)


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


@dataclass(frozen=True, kw_only=True)
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
        separation: Difference of the two best explanations [noise floors].
        joint: Joint with the largest difference.
    """

    name: str
    on: tuple[str, ...]
    seconds: float
    separation: float
    joint: str


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
