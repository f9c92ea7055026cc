"""`report.json` as it is read back for the page."""

import json
from pathlib import Path
from typing import NotRequired, TypedDict

from nas_data.errors import OptionError

REPORT = "report.json"


class Number(TypedDict):
    """A fitted parameter in SI units."""

    value: float
    unit: str
    interval95: list[float] | None


class Alternative(TypedDict):
    """What could stand in an effect's place, and the error it leaves [rad]."""

    effect: str
    joint: NotRequired[str | None]
    heldout_error_after: float


class Equal(TypedDict):
    """What the data cannot tell from a named effect."""

    effect: str
    joint: str | None


class Errors(TypedDict):
    """Error without and with an effect, in `unit`: rad, or m for a slide."""

    heldout_error_before: float
    heldout_error_after: float
    unit: NotRequired[str]


class Effect(TypedDict):
    """A named effect."""

    effect: str
    joint: str | None
    parameters: dict[str, Number]
    confidence: float
    evidence: Errors
    alternatives: list[Alternative]
    equals: NotRequired[list[Equal]]
    in_model_xml: bool


class Factor(TypedDict):
    """A parameter of the model that was changed."""

    parameter: str
    factor: float
    at_bound: NotRequired[bool]


class Rest(TypedDict):
    """A joint whose error stays above the noise."""

    joint: str
    ratio_to_noise: float
    goes_with: str


class Gap(TypedDict):
    """The gap over all joints of one kind, in `unit`; `after_model_xml` is what the written file alone leaves.

    `slides` holds the same of the slides where the arm has hinges as well.
    """

    metric: NotRequired[str]
    unit: str
    slides: NotRequired["Gap"]
    noise_floor: float
    before: float
    plain: NotRequired[float]
    after: float
    after_model_xml: NotRequired[float]
    delivered: NotRequired[str]
    conditioning: NotRequired[float]


class Shares(TypedDict):
    """Parts of the squared gap above the noise before anything was added."""

    names: float | None
    learned: float | None
    left: float | None


class Named(TypedDict):
    """An effect by name and place."""

    effect: str
    joint: str | None


class Placebo(TypedDict):
    """A wrong name in the right one's place, and the error that it leaves [rad]."""

    effects: list[Named]
    after: float
    text: str


class JointGap(TypedDict):
    """Errors of one joint, in `unit`: rad, or m for a slide."""

    floor: float
    one_step: float
    one_step_hold: float
    open_loop: float
    open_loop_hold: float
    open_loop_command: float | None
    ratio_to_noise: float
    unit: NotRequired[str]


class Bin(TypedDict):
    """The error of one joint under one condition [rad; slides m]; `rest` is that under the condition's others."""

    joint: str
    regime: str
    bin: str
    rmse: float
    rest: NotRequired[float]
    ratio_to_noise: float
    share: float
    significant: bool


class Check(TypedDict):
    """One look at the recording itself."""

    check: str
    finding: str
    ok: bool


class Find(TypedDict):
    """Where the gap is."""

    joints: dict[str, JointGap]
    regimes: list[Bin]
    audit: list[Check]
    undecidable: NotRequired[list[str]]


class Tried(TypedDict):
    """An experiment that could be recorded next."""

    name: str
    on: list[str]
    seconds: float
    separation: float
    joint: str


class Episodes(TypedDict):
    """Numbers of the episodes that were fitted and of those that judged."""

    train: list[int]
    heldout: list[int]


class Report(TypedDict):
    """The whole report; what a contract-only report lacks is marked."""

    verdict: str
    effects: list[Effect]
    retuned: list[Factor]
    unexplained: list[Rest]
    gap: Gap
    next_experiment: str | None
    episodes: Episodes
    seed: int
    seconds: float
    model: NotRequired[str]
    dataset: NotRequired[str]
    find: NotRequired[Find | None]
    shares: NotRequired[Shares | None]
    placebo: NotRequired[Placebo | None]
    experiments: NotRequired[list[Tried]]


def read_report(folder: Path) -> Report:
    """Read the report of a folder.

    Raises:
        OptionError: there is none, or it lacks a part.
    """
    path = folder / REPORT
    try:
        report: Report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise OptionError(
            f"{path} is not a gap report ({error}); make one with: nas gap DATASET --model MODEL"
        ) from None
    lacking = sorted(Report.__required_keys__ - set(report))
    if lacking:
        raise OptionError(f"{path} lacks {', '.join(lacking)}; make it anew with: nas gap DATASET --model MODEL")
    return report
