"""Strict reader of one table of a TOML file: keys are typed, and unknown keys are errors."""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches

from nas_data.count_of import count_of
from nas_data.errors import MapError


class MapSection:
    """One table of a map file. Read keys are removed; `finish` refuses the remaining ones.

    Args:
        values: The table's content.
        file: Name of its file in errors.
        name: Table's name, for example `read.position`; empty for the top of the file.
        inherited: Table of each key that comes from another table.
    """

    def __init__(
        self, values: Mapping[str, object], file: str, name: str = "", inherited: Mapping[str, str] | None = None
    ) -> None:
        self.values = values
        self.file = file
        self.name = name
        self._inherited = inherited or {}
        self._taken: set[str] = set()
        self._known: set[str] = set()

    def error(self, sentence: str, key: str = "") -> MapError:
        """Return an error that names the file and the table, or that of a key."""
        name = self._inherited.get(key, self.name)
        place = f"{self.file}, [{name}]" if name else self.file
        return MapError(f"{place}: {sentence}")

    def has(self, key: str) -> bool:
        """Return whether the key exists, and mark it as known."""
        self._known.add(key)
        return key in self.values

    def refuse(self, key: str, owner: str) -> None:
        """Raise MapError if a key is given that belongs to another setting, such as another file format."""
        if self.has(key):
            raise self.error(f"there is no key '{key}' here: it belongs to {owner}.", key)

    def text(self, key: str, default: str | None = None, choices: Sequence[str] = ()) -> str:
        """Read a string."""
        value = self._take(key, default)
        if not isinstance(value, str):
            raise self.error(f"'{key}' is {value!r}; it must be a text in quotes.", key)
        if choices and value not in choices:
            raise self.error(f"'{key}' is '{value}'; choose one of: {', '.join(choices)}.", key)
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Read a finite number."""
        value = self._take(key, default)
        if not _is_number(value):
            raise self.error(f"'{key}' is {value!r}; it must be a number.", key)
        return float(str(value))

    def positive(self, key: str, default: float | None = None) -> float:
        """Read a positive number."""
        value = self.number(key, default)
        if value <= 0:
            raise self.error(f"'{key}' is {value:g}; it must be above 0.", key)
        return value

    def flag(self, key: str, default: bool = False) -> bool:
        """Read a boolean."""
        value = self._take(key, default)
        if not isinstance(value, bool):
            raise self.error(f"'{key}' is {value!r}; it must be true or false.", key)
        return value

    def texts(self, key: str, default: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """Read a list of strings."""
        value = self._take(key, default)
        if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
            raise self.error(f"'{key}' is {value!r}; it must be a list of texts in quotes.", key)
        return tuple(value)

    def numbers(self, key: str, count: int, default: float | None = None) -> tuple[float, ...]:
        """Read one number for all, or a list of exactly `count` numbers."""
        value = self._take(key, default)
        if _is_number(value):
            return (float(str(value)),) * count
        if not isinstance(value, list) or not all(_is_number(item) for item in value):
            raise self.error(f"'{key}' is {value!r}; it must be a number or a list of numbers.", key)
        if len(value) != count:
            raise self.error(f"'{key}' has {count_of(len(value), 'number')}; {count} are needed.", key)
        return tuple(float(item) for item in value)

    def integers(self, key: str) -> tuple[int, ...]:
        """Read a list of non-negative integers."""
        value = self._take(key, None)
        if not isinstance(value, list) or not all(type(item) is int and item >= 0 for item in value):
            raise self.error(f"'{key}' is {value!r}; it must be a list of whole numbers, 0 or more.", key)
        return tuple(value)

    def table(self, key: str) -> "MapSection":
        """Read a sub-table; empty if it is missing."""
        value = self._take(key, {})
        name = f"{self.name}.{key}" if self.name else key
        if not isinstance(value, Mapping):
            raise self.error(f"'{key}' is {value!r}; it must be a table: [{name}].", key)
        return MapSection(value, self.file, name)

    def tables(self) -> dict[str, "MapSection"]:
        """Read all remaining keys as sub-tables."""
        return {key: self.table(key) for key in self.values if key not in self._taken}

    def finish(self) -> None:
        """Refuse remaining keys, so that a misspelt key is not ignored.

        Raises:
            MapError: a key is unknown; the message lists the known ones.
        """
        unknown = [key for key in self.values if key not in self._taken]
        if unknown:
            known = sorted(self._taken | self._known)
            near = get_close_matches(unknown[0], known, n=1)
            hint = f" (did you mean '{near[0]}'?)" if near else ""
            keys = ", ".join(known) or "none"
            raise self.error(f"there is no key '{unknown[0]}' here{hint}; the keys are: {keys}.", unknown[0])

    def _take(self, key: str, default: object) -> object:
        self._taken.add(key)
        value = self.values.get(key, default)
        if value is None:
            near = get_close_matches(key, [name for name in self.values if name not in self._taken], n=1)
            hint = f" (is '{near[0]}' a misspelling of it?)" if near else ""
            raise self.error(f"the key '{key}' is missing{hint}.")
        return value


def _is_number(value: object) -> bool:
    """Return whether a TOML value is a finite number; booleans are not."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")
