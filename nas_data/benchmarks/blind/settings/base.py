"""What a setting is: how a case's arm, recording conditions and commands are drawn, and what may hide how visibly."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from nas_data import registry
from nas_data.benchmarks.blind.arms import NominalArm
from nas_data.benchmarks.blind.case import Conditions, Hidden, Identity
from nas_data.benchmarks.blind.catalogue import EffectDraw

# conditions, number of episodes, range of each command (n, 2) [rad] → commands (E, T, n), poses held before (E, n);
# where a controller follows references with torques, these, of whole motions, from positions in that range
Episodes = Callable[[Conditions, int, np.ndarray, np.random.Generator], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class CaseSetting:
    """A sort of cases; the file `settings/xl320.py` holds the setting `xl320` as `SETTING`."""

    draw: Callable[[Identity], tuple[NominalArm, Conditions]]  # draws a case's nominal arm and its conditions
    episodes: Episodes  # draws commands, rounded to single precision as stored
    inside: Mapping[str, EffectDraw]  # what of the contract's table may hide
    outside: Mapping[str, EffectDraw]  # what else may hide
    least: float  # multiples of the noise floor from which an effect is judged
    most: float  # multiples beyond which an effect is drawn again: nobody needs a search for those
    rounds: int  # draws before a case is given up
    screen: str = "numpy"  # plant on which sizes are tried first, a fast one for cases of this sort
    # draws what hides in every case, whatever its family, for it is what the setting is about
    given: Callable[[Identity, NominalArm], tuple[Hidden, ...]] = lambda identity, arm: ()


def find_setting(name: str) -> CaseSetting:
    """Return a setting by its name.

    Raises:
        UnknownName: there is no such setting; lists those there are.
    """
    setting: CaseSetting = registry.import_plugin("benchmarks.blind.settings", name, "setting").SETTING
    return setting
