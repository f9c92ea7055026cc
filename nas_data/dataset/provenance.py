"""Provenance of a dataset: `meta/nas.json`, which nas keeps and LeRobot's tools drop."""

import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path

from nas_data.dataset.layout import PROVENANCE, read_json
from nas_data.errors import DatasetInvalid
from nas_data.typed_json import FormError, as_object, from_json

SCHEMA = 1
PACKAGES = ("nas_data", "lerobot", "mujoco", "pybullet", "numpy", "pyarrow", "scipy", "torch")


@cache
def read_package_versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that affect a dataset."""
    return {"python": platform.python_version(), **read_installed_versions(PACKAGES)}


def read_installed_versions(names: Iterable[str]) -> dict[str, str]:
    """Return the versions of those packages that are installed."""
    versions = {}
    for name in names:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


def format_current_time() -> str:
    """Return the present time, UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@dataclass(frozen=True)
class Parent:
    """A dataset from which another was made.

    Attributes:
        name: Its name and version, `ergojr_steps/v2-1a2b3c4d`, or its folder's name; never a path.
        content_hash: Its content hash.
    """

    name: str
    content_hash: str


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Content of `meta/nas.json`.

    Attributes:
        schema: Version of this schema.
        how: One of simulated, hardware, imported, paired, edited.
        robot: Robot's name.
        when: When it was recorded or made, UTC, ISO 8601.
        source: Source model: name, sha256, engine, engine version, effects with their parameters.
        target: Description of the simulated target or the hardware.
        signal: Command signal: excitation and its parameters.
        seeds: Seeds of every random draw.
        packages: Version of each package at that time.
        parents: Datasets from which it was made.
        derived: Features that were derived instead of recorded: feature → how.
        contiguous: Whether each next state is the state of the following frame, as in a recording.
        notes: Other remarks, as text.
        content_hash: Content hash of the dataset; set by the writer.
        files: SHA-256 of each file except the card and this one; set by the writer.
    """

    schema: int = SCHEMA
    how: str
    robot: str = "unknown"
    when: str = field(default_factory=format_current_time)
    source: Mapping[str, object] | None = None
    target: Mapping[str, object] | None = None
    signal: Mapping[str, object] | None = None
    seeds: tuple[int, ...] = ()
    packages: Mapping[str, str] = field(default_factory=lambda: dict(read_package_versions()))
    parents: tuple[Parent, ...] = ()
    derived: Mapping[str, str] = field(default_factory=dict)
    contiguous: bool = False
    notes: str = ""
    content_hash: str = ""
    files: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> dict[str, object]:
        """Return the JSON content of `meta/nas.json`."""
        return as_object(self)

    @classmethod
    def from_json(cls, content: Mapping[str, object], where: str = "The provenance") -> "Provenance":
        """Read the JSON content; unknown keys are ignored.

        Raises:
            DatasetInvalid: the schema is newer, or the content has another form.
        """
        schema = content.get("schema")
        if not isinstance(schema, int) or schema > SCHEMA:
            raise DatasetInvalid(f"{where} has schema {schema}; this nas_data reads up to {SCHEMA}: update nas_data.")
        try:
            return from_json(cls, content)
        except FormError as error:
            raise DatasetInvalid(
                f"{where} is not a provenance of nas_data ({error}); restore it from a copy."
            ) from None


def read_provenance(root: Path) -> Provenance | None:
    """Read a dataset's provenance; None if it has none, as datasets of LeRobot's tools.

    Raises:
        DatasetInvalid: the file is damaged or newer than this package.
    """
    path = root / PROVENANCE
    return Provenance.from_json(read_json(path), str(path)) if path.is_file() else None
