"""Interface of a setting: how arms, recording conditions, commands and hidden effects are drawn."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from nas_data import registry
from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Conditions, Hidden, Identity
from nas_data.benchmarks.blind.catalogue import EffectDraw

# conditions, number of episodes, range of each command (n, 2) [rad] → commands (E, T, n), poses held before (E, n). For
# a torque controller: references of whole motions, and ranges of position.
Episodes = Callable[[Conditions, int, np.ndarray, np.random.Generator], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class CaseSetting:
    """A kind of cases; the file `settings/xl320.py` holds the setting `xl320` as `SETTING`."""

    draw: Callable[[Identity], tuple[NominalArm, Conditions]]  # draws a case's nominal arm and its conditions
    episodes: Episodes  # draws commands, rounded to single precision as stored
    inside: Mapping[str, EffectDraw]  # effects of the contract's table that may be hidden
    outside: Mapping[str, EffectDraw]  # other effects that may be hidden
    least: float  # multiples of the noise floor from which an effect is judged
    most: float  # multiples of the noise floor above which an effect is drawn again: it would be found without a search
    rounds: int  # draws before a case is given up
    screen: str = "numpy"  # plant on which sizes are tried first, a fast one for such cases
    # draws effects that are hidden in every case, whatever its family
    given: Callable[[Identity, NominalArm], tuple[Hidden, ...]] = lambda identity, arm: ()


def find_setting(name: str) -> CaseSetting:
    """Return a setting by its name.

    Raises:
        UnknownName: there is no such setting; lists the settings.
    """
    setting: CaseSetting = registry.import_plugin("benchmarks.blind.settings", name, "setting").SETTING
    return setting
