"""What a gap report is made of: typed records of effects, errors, joints, conditions and experiments."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from nas_data.joint_units import HINGE
from nas_data.typed_json import as_object

NAME = {"key": "effect"}
OPTIONAL = {"optional": True}


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """A parameter of an effect.

    Attributes:
        value: In `unit`.
        unit: SI.
        interval95: Where it lies with 95 %, if the name is right; None where that is not known.
    """

    value: float
    unit: str = ""
    interval95: tuple[float, float] | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True)
class EffectName:
    """An effect by name and joint; joint is None where it belongs to the whole arm."""

    name: str = field(metadata=NAME)
    joint: str | None = None

    def __str__(self) -> str:
        """Return the name with its joint."""
        return f"{self.name} in {self.joint}" if self.joint else self.name


@dataclass(frozen=True, kw_only=True)
class Alternative(EffectName):
    """What could stand in an effect's place.

    Attributes:
        parameters: Fitted values in SI units, by name.
        heldout_error_after: Error that it leaves, in the unit of the effect's evidence.
    """

    parameters: Mapping[str, float] | None = field(default=None, metadata=OPTIONAL)
    heldout_error_after: float


@dataclass(frozen=True, kw_only=True)
class HeldoutErrors:
    """Held-out open-loop RMSE without and with an effect, in `unit`: rad, or m for a slide."""

    heldout_error_before: float
    heldout_error_after: float
    unit: str = HINGE.si


@dataclass(frozen=True, kw_only=True, repr=False)
class NamedEffect(EffectName):
    """An effect that the model lacks.

    Attributes:
        parameters: Fitted, by name.
        confidence: Probability that name and joint are right.
        evidence: Error without and with it, everything else fitted anew.
        alternatives: What came second and after in its place.
        equals: Those that these data cannot tell from it.
        in_model_xml: Whether `model.xml` holds it; `effects.json` always does.
    """

    parameters: Mapping[str, FittedParameter]
    confidence: float
    evidence: HeldoutErrors
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
    """The runner-up in the place of the surest name.

    Attributes:
        effects: All effects of that model.
        after: Held-out error that it leaves, in the unit of the gap.
        text: What stands in the place of what.
    """

    effects: tuple[FittedEffect, ...]
    after: float
    text: str


@dataclass(frozen=True, kw_only=True)
class Retuned:
    """A parameter that the model has and that was changed.

    Attributes:
        parameter: Joint and kind, for example `m2.damping`.
        factor: New value over the model's.
        at_bound: Whether the fit ended on the bound of what a real arm may be off by.
    """

    parameter: str
    factor: float
    at_bound: bool = False


@dataclass(frozen=True, kw_only=True)
class JointDescription:
    """How far a joint is explained.

    Attributes:
        complete: Confidence that nothing is missing there.
        ratio_to_noise: Held-out error over the noise floor.
        stable: Whether two halves of the recording agree on its parameters.
    """

    complete: float
    ratio_to_noise: float
    stable: bool


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """A joint whose error stays above the noise: how many noise floors it is, and what it goes with."""

    joint: str
    ratio_to_noise: float
    goes_with: str


@dataclass(frozen=True, kw_only=True)
class GapErrors:
    """Held-out open-loop RMSE of positions over joints of one kind, in `unit`: rad, or m for slides.

    Attributes:
        noise_floor: What the noise of the readings lets one expect.
        before: Of the model as handed over.
        plain: Of the plain fit: every smooth parameter fitted, no name given.
        after: With what is named.
        after_model_xml: Of `model.xml` alone, where a file cannot hold all that is named.
    """

    unit: str = HINGE.si
    noise_floor: float | None = field(default=None, metadata=OPTIONAL)
    before: float
    plain: float | None = field(default=None, metadata=OPTIONAL)
    after: float
    after_model_xml: float | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True)
class ArmGap(GapErrors):
    """The gap of the whole arm: errors over its hinges, or over its slides where it has no hinge.

    Attributes:
        metric: What the errors are, in words.
        delivered: What `model.xml` is: `names`, `names and plain`, `plain` or `given`.
        slides: Errors over the slides of an arm that has hinges as well.
        per_joint: Errors of each joint.
        conditioning: Condition number of the last fit.
    """

    metric: str = ""
    delivered: str | None = field(default=None, metadata=OPTIONAL)
    slides: GapErrors | None = field(default=None, metadata=OPTIONAL)
    per_joint: Mapping[str, GapErrors] = field(default_factory=dict)
    conditioning: float | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True)
class Shares:
    """Parts of the squared gap above the noise: what the names explain, what φ learned on top, what is left."""

    names: float | None
    learned: float | None = None
    left: float | None


@dataclass(frozen=True, kw_only=True)
class JointGap:
    """Root mean squared position errors of one joint under the model as handed over, in `unit`.

    Attributes:
        floor: Noise of the readings.
        one_step: Of the model, reset to each measured state.
        one_step_hold: Of staying at the measured position.
        open_loop: Of the model, started once per episode.
        open_loop_hold: Of staying in the first pose.
        open_loop_command: Of the command itself; None where commands are torques.
        ratio_to_noise: `open_loop` over `floor`.
        repeatability: Spread between repeats of the same commands; None where none was repeated.
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
    """The error of one joint under one condition; errors of a slide are in metres.

    Attributes:
        joint: Which.
        regime: Name of the condition.
        bin: Name of the bin.
        rows: Rows in it.
        rmse: Error there [rad].
        mean: Mean error there, model minus measured [rad]; of opposite signs in the two directions where friction,
            play or a lag is missing in the model.
        rest: Error in the condition's other bins [rad].
        ratio_to_noise: `rmse` over the noise floor.
        share: Part of the joint's total squared error.
        chance: Chance of a difference to the rest as large, were there none; 1 where the joint has no gap to place.
        significant: Whether it differs from the rest, all bins of the arm considered.
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
    """One thing that was looked at in the recording.

    Attributes:
        check: What.
        finding: One or two sentences: what was found, and what it means.
        ok: Whether the recording can be taken as it is in this respect.
    """

    check: str
    finding: str
    ok: bool = True


@dataclass(frozen=True, kw_only=True)
class GapFindings:
    """Where the gap is.

    Attributes:
        joints: Errors of each joint.
        regimes: Errors of each joint under each condition.
        audit: What was looked at in the recording.
        undecidable: What these data cannot decide, a sentence each.
    """

    joints: Mapping[str, JointGap]
    regimes: tuple[Bin, ...]
    audit: tuple[Check, ...]
    undecidable: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Return all of it, in SI units."""
        return as_object(self)

    def text(self) -> str:
        """Return a short table in degrees and millimetres, and what was noticed."""
        from nas_data.gap.finding.text import describe_findings

        return describe_findings(self.joints, self.regimes, self.audit, self.undecidable)


@dataclass(frozen=True, kw_only=True)
class TriedExperiment:
    """An experiment that could be recorded next.

    Attributes:
        name: What the joints do.
        on: Joints that move.
        seconds: Its length.
        separation: Difference of the two best explanations in it [noise floors].
        joint: Where that difference is.
    """

    name: str
    on: tuple[str, ...]
    seconds: float
    separation: float
    joint: str


@dataclass(frozen=True, kw_only=True)
class EpisodeNumbers:
    """Numbers of the episodes that were fitted, and of those that judged."""

    train: tuple[int, ...]
    heldout: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class MadeFrom:
    """What a report was made from, and with.

    Attributes:
        command: What makes it again.
        content_hash: Of the recording.
        model_sha256: Of the model file as handed over.
        versions: Of Python and of packages, by name.
    """

    command: str
    content_hash: str
    model_sha256: str
    versions: Mapping[str, str]
