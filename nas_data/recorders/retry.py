"""Retries of bus transactions: transient errors are repeated and counted, persistent ones are raised."""

from collections.abc import Callable
from typing import TypeVar

from nas_data.errors import BadReply, NobodyAnswers, ServoSilent

TRANSIENT_ERRORS = (BadReply, ServoSilent, NobodyAnswers)  # a loose plug or noise may cause them
TRIES = 3  # attempts in a row before the bus counts as lost

T = TypeVar("T")


class Retry:
    """Repeats transactions with an arm; each one is itself several attempts of the bus.

    Attributes:
        failures: Number of failed attempts.
        before_retry: Called before each repetition.
    """

    def __init__(self, tries: int = 1, before_retry: Callable[[], None] = lambda: None) -> None:
        """Set the largest number of attempts; by default one, without repetition."""
        self.failures, self.before_retry, self._tries = 0, before_retry, tries

    def call(self, what: Callable[[], T]) -> T:
        """Call a function, repeat it after transient errors, and return its result.

        Args:
            what: The transaction.

        Raises:
            ArmError: the retry limit is reached, or the error is not transient.
        """
        for _ in range(self._tries - 1):
            try:
                return what()
            except TRANSIENT_ERRORS:
                self.failures += 1
                self.before_retry()
        return what()
