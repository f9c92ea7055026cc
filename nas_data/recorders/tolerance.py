"""What of an arm's line may fail now and then: it is asked again and counted; what lasts is an error."""

from collections.abc import Callable
from typing import TypeVar

from nas_data.errors import BadReply, NobodyAnswers, ServoSilent

PASSING = (BadReply, ServoSilent, NobodyAnswers)  # what may have been a loose plug or noise
TRIES = 3  # times that something is asked in a row before the line is taken to be lost

T = TypeVar("T")


class Tolerance:
    """How often an arm is asked again; each time is itself several attempts of the bus.

    Attributes:
        failures: How often it was.
        meanwhile: Done before each.
    """

    def __init__(self, tries: int = 1, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Set how often the same is asked in a row; only once where nothing is said."""
        self.failures, self.meanwhile, self._tries = 0, meanwhile, tries

    def ask(self, what: Callable[[], T]) -> T:
        """Return what an exchange brings.

        Raises:
            ArmError: it failed as often as is borne, or for a reason that does not pass.
        """
        for _ in range(self._tries - 1):
            try:
                return what()
            except PASSING:
                self.failures += 1
                self.meanwhile()
        return what()
