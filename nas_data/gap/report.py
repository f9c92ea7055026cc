"""The gap report: what `report.json` holds as one typed record, with the files beside it.

Nothing else writes `report.json`, and nothing else reads it.
"""

import io
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.errors import OptionError, UnknownName
from nas_data.gap.output_folder import ASSETS, FILES, FOLDERS, check_free, clear
from nas_data.joint_units import HINGE
from nas_data.typed_json import FormError, LacksKeys, as_object, from_json
from nas_data.visible_files import visible
from nas_data.whole_file import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from nas_data.gap.showing.series import Series

REPORT = "report.json"
SCHEMA = 2
NAME = {"key": "effect"}
OPTIONAL = {"optional": True}
ANEW = "make it anew with: nas gap DATASET --model MODEL"


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


@dataclass(frozen=True, kw_only=True, repr=False)
class GapReport:
    """What a model lacks, by a recording: `report.json` typed, and the files beside it.

    Attributes:
        schema: Version of the file's form.
        dataset: What the recording is called.
        model: What the model is called.
        verdict: `none`, `retuned`, `explained`, `partly_explained` or `unexplained`.
        effects: What is missing, the surest name first.
        retuned: Parameters of the model that were changed.
        joints: How far each joint is explained.
        unexplained: Joints with a rest above the noise, the worst first.
        gap: Errors before and after.
        shares: What explains how much of the gap.
        placebo: What a wrong name achieves.
        next_experiment: What to record next; None where all names are sure.
        experiments: All that were compared.
        find: Where the gap is.
        episodes: Which were fitted, and which judged.
        seed: Of all random draws.
        seconds: Wall time of the search [s].
        made_from: Command, hashes and versions.
        files: Content of the other files of the report's folder, by their path in it.
    """

    schema: int = SCHEMA
    dataset: str = ""
    model: str = ""
    verdict: str
    effects: tuple[NamedEffect, ...]
    retuned: tuple[Retuned, ...]
    joints: Mapping[str, JointDescription] = field(default_factory=dict)
    unexplained: tuple[Unexplained, ...]
    gap: ArmGap
    shares: Shares | None = None
    placebo: Placebo | None = None
    next_experiment: str | None
    experiments: tuple[TriedExperiment, ...] = ()
    find: GapFindings | None = None
    episodes: EpisodeNumbers
    seed: int
    seconds: float
    made_from: MadeFrom | None = field(default=None, metadata=OPTIONAL)
    files: Mapping[str, bytes] = field(default_factory=dict, compare=False, metadata={"key": None})

    def __repr__(self) -> str:
        """Return verdict, names and how the gap shrinks, in a line."""
        named = ", ".join(f"{effect} ({effect.confidence:.2f})" for effect in self.effects)
        shrinks = f"{self.gap.before:.3g} → {self.gap.after:.3g} {self.gap.unit}"
        return f"GapReport({self.verdict}{': ' if named else ''}{named}; {shrinks})"

    def __str__(self) -> str:
        """Return what a person wants to read first, a few lines."""
        from nas_data.gap.summary import findings

        return "\n".join(findings(self))

    def to_json(self) -> dict[str, object]:
        """Return what `report.json` holds."""
        return as_object(self)

    @classmethod
    def load(cls, folder: str | Path) -> "GapReport":
        """Read the report of a folder.

        Args:
            folder: Written by `nas gap` or `save`.

        Raises:
            OptionError: there is none, or it lacks a part.
        """
        report = cls.read(Path(folder) / REPORT)
        return report.with_files(Path(folder))

    @classmethod
    def read(cls, path: Path) -> "GapReport":
        """Read a `report.json` alone, without the files beside it.

        Raises:
            OptionError: it is none, or lacks a part.
        """
        try:
            return from_json(cls, json.loads(path.read_text(encoding="utf-8")))
        except LacksKeys as error:
            raise OptionError(f"{path} lacks {', '.join(error.keys)}; {ANEW}") from None
        except FormError as error:
            raise OptionError(f"{path} is not a gap report ({error}); {ANEW}") from None
        except (OSError, ValueError) as error:
            raise OptionError(f"{path} is not a gap report ({error}); {ANEW}") from None

    def with_files(self, folder: Path) -> "GapReport":
        """Return the report with the files of its folder."""
        paths = [folder / name for name in FILES if name != REPORT and (folder / name).is_file()]
        paths += [path for name in (*FOLDERS, ASSETS) for path in visible(folder / name, "**/*") if path.is_file()]
        return replace(self, files={path.relative_to(folder).as_posix(): path.read_bytes() for path in paths})

    def save(self, folder: str | Path) -> Path:
        """Write the report with all its files: page, model, effects, figures.

        Args:
            folder: Where; an earlier report in it is replaced.

        Returns:
            The folder.

        Raises:
            OutputExists: the folder holds what no report wrote, and this one would replace.
        """
        folder = Path(folder)
        check_free(folder)
        folder.mkdir(parents=True, exist_ok=True)
        clear(folder)
        for name, content in self.files.items():
            write_whole(folder / name, content)
        self.write(folder)
        return folder

    def write(self, folder: Path) -> None:
        """Write `report.json` alone."""
        text = json.dumps(self.to_json(), indent=1, allow_nan=False)
        write_whole(folder / REPORT, text.encode())

    @property
    def series(self) -> "Series":
        """Held-out episodes, and what each model makes of their commands.

        Raises:
            OptionError: the report has none.
        """
        from nas_data.gap.showing.series import SERIES, Series

        if SERIES not in self.files:
            raise OptionError(f"This report has no {SERIES}, so that there is nothing to draw; {ANEW}")
        return Series.read_file(io.BytesIO(self.files[SERIES]), SERIES)

    def plot(self, joint: str | None = None) -> "Figure":
        """Draw the held-out episodes: one joint as it moved and as each model predicts, or the errors of all joints.

        Args:
            joint: Its name; the figure shows the episode that the model as handed over predicts worst. None for the
                errors of every joint beside the noise floor.

        Returns:
            A matplotlib figure: `figure.savefig("m3.png")`; notebooks show it.

        Raises:
            UnknownName: there is no such joint.
            OptionError: the report has no series to draw.
        """
        from nas_data.gap.showing.figures import draw_all_joints, draw_joint

        if "IPython" in sys.modules:
            import matplotlib.pyplot  # noqa: F401 (notebooks show figures once this is loaded)
        series = self.series
        if joint is None:
            return draw_all_joints(self, series)
        if joint not in series.joints:
            raise UnknownName("joint", joint, series.joints)
        return draw_joint(self, series, series.joints.index(joint))
