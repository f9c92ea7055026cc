"""Interface of excitations: random command signals for a batch of episodes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields

import numpy as np

from nas_data import registry
from nas_data.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Base of the excitations; the file `excitations/a_b.py` holds the excitation `a_b` as class `AB`.

    Attributes:
        share: Share of each joint's range that is used, around its middle.
    """

    share: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 < value < np.inf:
                raise OptionError(f"{self.name()}: {field.name} is {value}; it must be above zero.")
        if self.share > 1:
            raise OptionError(f"{self.name()}: share is {self.share}; it must lie in 0 … 1.")

    @classmethod
    def name(cls) -> str:
        """Return the excitation's name: the class name in snake case, which is the name of its file."""
        return registry.to_snake_case(cls.__name__)

    def shape(self, rng: np.random.Generator, episodes: int, steps: int, period: float, span: np.ndarray) -> np.ndarray:
        """Draw normalised commands.

        Args:
            rng: Random generator.
            episodes: Number of episodes E.
            steps: Control steps T of each.
            period: Control period [s].
            span: Used half range of each joint [rad or N·m; for slides in equivalents of a radian], shape (n,).

        Returns:
            Numbers from −1 (lower end) to 1 (upper end), shape (E, T, n).
        """
        raise NotImplementedError(f"{type(self).__name__} has no shape()")

    def commands(
        self,
        rng: np.random.Generator,
        episodes: int,
        steps: int,
        period: float,
        low: np.ndarray,
        high: np.ndarray,
        radians: np.ndarray | float = 1.0,
    ) -> np.ndarray:
        """Draw commands within limits.

        Args:
            rng: Random generator.
            episodes: Number of episodes E.
            steps: Control steps T of each.
            period: Control period [s].
            low: Lowest command of each joint [rad or N·m], shape (n,).
            high: Highest command of each joint, shape (n,).
            radians: Equivalent of a radian at each joint, shape (n,); see `joint_units.compute_angle_scales`.

        Returns:
            Commands, shape (E, T, n), float64.
        """
        middle, span = (low + high) / 2, (high - low) / 2 * self.share
        shape = self.shape(rng, episodes, steps, period, span / radians)
        return np.clip(middle + span * shape, low, high)  # the clip only removes rounding errors

    def to_json(self) -> dict[str, object]:
        """Return the excitation and its parameters for provenance."""
        return {"excitation": self.name(), "parameters": asdict(self)}


def check_band(excitation: Excitation, slowest: float, fastest: float) -> None:
    """Raise OptionError if the lowest frequency [Hz] of an excitation is above the highest."""
    if slowest > fastest:
        raise OptionError(
            f"{excitation.name()}: slowest is {slowest:g} Hz, above fastest, {fastest:g} Hz; give both, slowest first."
        )


def hold(values: np.ndarray, steps: int, each: int) -> np.ndarray:
    """Repeat values (E, K, n) for `each` control steps, and cut to shape (E, steps, n)."""
    return np.repeat(values, each, axis=1)[:, :steps]


def draw_signs(rng: np.random.Generator, episodes: int, joints: int) -> np.ndarray:
    """Draw a sign for each episode and joint, shape (E, 1, n)."""
    return rng.choice([-1.0, 1.0], size=(episodes, 1, joints))


def find_excitation(name: str) -> type[Excitation]:
    """Return the class of an excitation by its name.

    Raises:
        UnknownName: there is no such excitation; the message lists the known ones.
    """
    return registry.find_plugin("excitations", name, "excitation", Excitation)


def make_excitation(name: str, values: Mapping[str, float]) -> Excitation:
    """Build an excitation from its name and parameters; missing parameters have their defaults.

    Raises:
        UnknownName: there is no such excitation.
        OptionError: a parameter is unknown or out of its range.
    """
    kind = find_excitation(name)
    known = {field.name: field.type for field in fields(kind)}
    for key, value in values.items():
        if key not in known:
            raise OptionError(f"{name} has no parameter '{key}'; it has: {', '.join(sorted(known))}.")
        if known[key] is int and not (np.isfinite(value) and value == int(value)):
            raise OptionError(f"{name}: {key} is {value}; it must be a whole number.")
    return kind(**{key: int(value) if known[key] is int else value for key, value in values.items()})


def parse(text: str) -> Excitation:
    """Parse an excitation from the command line: `steps`, or `sine:slowest=0.2,fastest=1`.

    Raises:
        UnknownName: there is no such excitation.
        OptionError: the text is malformed, or a parameter is unknown or out of its range.
    """
    name, _, rest = text.partition(":")
    pairs = [part.partition("=") for part in rest.split(",") if part]
    try:
        values = {key.strip(): float(value) for key, _, value in pairs}
    except ValueError:
        raise OptionError(f"'{text}' is not an excitation; write NAME:PARAMETER=NUMBER,….") from None
    return make_excitation(name, values)
