"""Scores that know their objective, so that only comparable ones are compared."""

from dataclasses import dataclass


class ObjectiveMismatch(AssertionError):
    """Losses of two objectives were compared."""


@dataclass(frozen=True)
class Score:
    """A loss with or without a price [nats]; lower is better.

    Attributes:
        nats: Value.
        objective: Number of its objective; only scores of the same objective are compared.
    """

    nats: float
    objective: int

    def __add__(self, nats: float) -> "Score":
        """Return the score plus some nats."""
        return Score(self.nats + nats, self.objective)

    def over(self, other: "Score") -> float:
        """Return the difference to another score [nats]; positive if this one is worse.

        Raises:
            ObjectiveMismatch: they belong to different objectives.
        """
        if self.objective != other.objective:
            raise ObjectiveMismatch(f"scores of the objectives {self.objective} and {other.objective} were compared")
        return self.nats - other.nats

    def __lt__(self, other: "Score") -> bool:
        return self.over(other) < 0

    def __gt__(self, other: "Score") -> bool:
        return self.over(other) > 0

    def __le__(self, other: "Score") -> bool:
        return self.over(other) <= 0

    def __ge__(self, other: "Score") -> bool:
        return self.over(other) >= 0
