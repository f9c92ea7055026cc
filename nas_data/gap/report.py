"""Gap report: content of `report.json` as a typed record, with the files beside it.

This module alone reads and writes `report.json`.
"""

import io
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from nas_data.atomic_file import write_atomic
from nas_data.errors import OptionError, UnknownName
from nas_data.gap.output_folder import ASSETS, FILES, FOLDERS, PHI, check_free, clear_report
from nas_data.gap.report_effects import OPTIONAL, NamedEffect, Placebo
from nas_data.gap.report_parts import (
    ArmGap,
    EpisodeNumbers,
    GapFindings,
    JointDescription,
    LearnedCorrection,
    MadeFrom,
    Retuned,
    Shares,
    TriedExperiment,
    Unexplained,
)
from nas_data.typed_json import FormError, LacksKeys, as_object, from_json
from nas_data.visible_files import list_visible_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from nas_data.gap.showing.series import Series

REPORT = "report.json"
SCHEMA = 2
REMEDY = "make it again with: nas gap DATASET --model MODEL --out DIR"


@dataclass(frozen=True, kw_only=True, repr=False)
class GapReport:
    """Result of `nas gap`: content of `report.json`, and the files beside it.

    Attributes:
        schema: Version of the file's format.
        dataset: Name of the recording.
        model: Name of the model.
        verdict: `none`, `retuned`, `explained`, `partly_explained` or `unexplained`.
        effects: Missing effects, highest confidence first.
        retuned: Changed parameters of the model.
        joints: Completeness of each joint.
        unexplained: Joints whose gap has no name: those with an error above the noise, largest first, then those at the
            noise only with a large change of a parameter.
        gap: Errors before and after.
        conditioning: Condition number of the final fit; above 10⁶, the data do not determine all parameters.
        shares: Explained shares of the gap.
        phi: Errors without and with φ, which is left out if it does not help; None if it was not trained.
        placebo: Error with a wrong name.
        next_experiment: Proposed experiment; None if all names are certain.
        experiments: All experiments that were compared.
        find: Location of the gap.
        episodes: Fitted and held-out episodes.
        seed: Seed of all random numbers.
        seconds: Wall time of the search [s].
        registers: Servo registers of the recording that the model was given, by register and joint; None if none.
        made_from: Command, hashes and versions.
        files: Content of the other files of the report's folder, by relative path.
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
    conditioning: float | None = field(default=None, metadata=OPTIONAL)
    shares: Shares | None = None
    phi: LearnedCorrection | None = field(default=None, metadata=OPTIONAL)
    placebo: Placebo | None = None
    next_experiment: str | None
    experiments: tuple[TriedExperiment, ...] = ()
    find: GapFindings | None = None
    episodes: EpisodeNumbers
    seed: int
    seconds: float
    registers: Mapping[str, Mapping[str, float]] | None = field(default=None, metadata=OPTIONAL)
    made_from: MadeFrom | None = field(default=None, metadata=OPTIONAL)
    files: Mapping[str, bytes] = field(default_factory=dict, compare=False, metadata={"key": None})

    def __repr__(self) -> str:
        """Return verdict, names and errors on one line."""
        named = ", ".join(f"{effect} ({effect.confidence:.2f})" for effect in self.effects)
        shrinks = f"{self.gap.before:.3g} → {self.gap.after:.3g} {self.gap.unit}"
        return f"GapReport({self.verdict}{': ' if named else ''}{named}; {shrinks})"

    def __str__(self) -> str:
        """Return the main results, a few lines."""
        from nas_data.gap.summary import list_findings

        return "\n".join(list_findings(self))

    def to_json(self) -> dict[str, object]:
        """Return the content of `report.json`."""
        return as_object(self)

    @classmethod
    def load(cls, folder: str | Path) -> "GapReport":
        """Read the report of a folder.

        Args:
            folder: Folder written by `nas gap` or `save`.

        Raises:
            OptionError: the report is missing or incomplete.
        """
        report = cls.read(Path(folder) / REPORT)
        return report.with_files(Path(folder))

    @classmethod
    def read(cls, path: Path) -> "GapReport":
        """Read a `report.json` without the files beside it.

        Raises:
            OptionError: the file is not a report, or incomplete.
        """
        try:
            return from_json(cls, json.loads(path.read_text(encoding="utf-8")))
        except LacksKeys as error:
            raise OptionError(f"{path} lacks {', '.join(error.keys)}; {REMEDY}") from None
        except FormError as error:
            raise OptionError(f"{path} is not a gap report ({error}); {REMEDY}") from None
        except (OSError, ValueError) as error:
            raise OptionError(f"{path} is not a gap report ({error}); {REMEDY}") from None

    def with_files(self, folder: Path) -> "GapReport":
        """Return the report with the files of its folder."""
        paths = [folder / name for name in FILES if name != REPORT and (folder / name).is_file()]
        is_own = self.phi is not None and self.phi.helps  # else the φ there is of an earlier report
        paths += [
            path
            for name in (*FOLDERS, ASSETS)
            if name != PHI or is_own
            for path in list_visible_files(folder / name, "**/*")
            if path.is_file()
        ]
        return replace(self, files={path.relative_to(folder).as_posix(): path.read_bytes() for path in paths})

    def save(self, folder: str | Path) -> Path:
        """Write the report with all its files: page, model, effects, figures.

        Args:
            folder: Output folder; an earlier report in it is replaced.

        Returns:
            The folder.

        Raises:
            OutputExists: the folder holds files that no report wrote and this one would replace.
        """
        folder = Path(folder)
        check_free(folder)
        folder.mkdir(parents=True, exist_ok=True)
        clear_report(folder)
        for name, content in self.files.items():
            write_atomic(folder / name, content)
        self.write(folder)
        return folder

    def write(self, folder: Path) -> None:
        """Write `report.json` alone."""
        text = json.dumps(self.to_json(), indent=1, allow_nan=False)
        write_atomic(folder / REPORT, text.encode())

    @property
    def series(self) -> "Series":
        """Held-out episodes with the predictions of each model.

        Raises:
            OptionError: the report has none.
        """
        from nas_data.gap.showing.series import SERIES, Series

        if SERIES not in self.files:
            raise OptionError(f"This report has no {SERIES}, so nothing can be drawn; {REMEDY}")
        return Series.read_file(io.BytesIO(self.files[SERIES]), SERIES)

    def plot(self, joint: str | None = None) -> "Figure":
        """Draw measured and predicted motion of one joint, or the held-out errors of all joints.

        Args:
            joint: Name of the joint, shown in the episode with the largest error of the given model. None for the
                errors of all joints beside the noise floor.

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
