"""The servos' settings over a recording: as they were read before each episode, kept where they change."""

from collections.abc import Mapping
from typing import Self

from nas_data.hardware.arms.base import Registers

KEY = "registers"  # under which provenance holds them, in the target


class Settings:
    """Registers by the episode from which they hold."""

    def __init__(self, known: Mapping[int, Registers] | None = None) -> None:
        self._known = dict(known or {})

    @classmethod
    def of(cls, target: Mapping[str, object] | None) -> Self:
        """Read them from a recording's provenance."""
        stored = (target or {}).get(KEY)
        entries = stored if isinstance(stored, list) else []
        return cls({int(entry["from_episode"]): entry["joints"] for entry in entries})

    def note(self, episode: int, registers: Registers) -> None:
        """Take note of what was read before an episode; what was noted of it and of later ones is forgotten."""
        self._known = {number: known for number, known in self._known.items() if number < episode}
        if not self._known or self._known[max(self._known)] != registers:
            self._known[episode] = registers

    def to_json(self) -> list[dict[str, object]]:
        """Return what provenance records: the first episode for which they hold, then joint by joint."""
        return [{"from_episode": number, "joints": known} for number, known in sorted(self._known.items())]
