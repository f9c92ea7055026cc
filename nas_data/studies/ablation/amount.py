"""Amount of training data: a number of episodes, or of minutes cut from them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from nas_data.errors import OptionError

Unit = Literal["episodes", "minutes"]
ALL = "all"


@dataclass(frozen=True, order=True)
class Amount:
    """An amount of training data."""

    value: float  # number of episodes or minutes; infinite for all
    unit: Unit

    @classmethod
    def of(cls, word: object, unit: Unit) -> "Amount":
        """Read the number, or `all`, from JSON."""
        return cls(math.inf if word == ALL else float(str(word)), unit)

    @property
    def is_all(self) -> bool:
        """Whether the amount is all data."""
        return math.isinf(self.value)

    @property
    def word(self) -> float | str:
        """The number, or `all`, for JSON."""
        return ALL if self.is_all else self.value

    def __str__(self) -> str:
        """Return the amount with its unit."""
        return f"{ALL if self.is_all else f'{self.value:g}'} {self.unit[:-1] if self.value == 1 else self.unit}"


def parse(texts: Sequence[str], unit: Unit) -> tuple[Amount, ...]:
    """Parse amounts such as `10,25,all`, in one or several words; sorted, without duplicates.

    Raises:
        OptionError: there is no amount, one is not positive, or a number of episodes is not an integer.
    """
    option = "--counts" if unit == "episodes" else "--minutes"
    found = {Amount(parse_number(word, option, unit), unit) for word in split_words(texts)}
    if not found:
        raise OptionError(f"{option} names no amount; give some with commas between, such as 1,2,5,{ALL}.")
    return tuple(sorted(found))


def split_words(texts: Sequence[str]) -> list[str]:
    """Split texts at commas."""
    return [word.strip() for text in texts for word in text.split(",") if word.strip()]


def parse_number(word: str, option: str, unit: Unit) -> float:
    """Read one amount; infinite for `all`."""
    if word == ALL:
        return math.inf
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if 0 < value < math.inf and (unit == "minutes" or value.is_integer()):
        return value
    kind = "whole numbers" if unit == "episodes" else "numbers"
    raise OptionError(f"{option} has '{word}'; give {kind} above 0, or {ALL}, with commas between.")
