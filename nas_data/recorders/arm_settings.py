"""History of the servos' settings during a recording: an entry for each change."""

from collections.abc import Mapping
from typing import Self

from nas_data.hardware.arms.base import Registers

KEY = "registers"  # under which provenance holds them, in the target


class Settings:
    """Registers, each with the first episode for which they hold."""

    def __init__(self, known: Mapping[int, Registers] | None = None) -> None:
        self._known = dict(known or {})

    @classmethod
    def of(cls, target: Mapping[str, object] | None) -> Self:
        """Read the history from a recording's provenance."""
        stored = (target or {}).get(KEY)
        entries = stored if isinstance(stored, list) else []
        return cls({int(entry["from_episode"]): entry["joints"] for entry in entries})

    def record(self, episode: int, registers: Registers) -> None:
        """Add the registers read before an episode; entries of this and of later episodes are dropped."""
        self._known = {number: known for number, known in self._known.items() if number < episode}
        if not self._known or self._known[max(self._known)] != registers:
            self._known[episode] = registers

    def to_json(self) -> list[dict[str, object]]:
        """Return the history for provenance: each entry has its first episode and the registers of each joint."""
        return [{"from_episode": number, "joints": known} for number, known in sorted(self._known.items())]
