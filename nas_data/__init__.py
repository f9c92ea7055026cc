"""Neural-augmented robot simulation: paired recordings in, better simulators and transferable policies out.

`import nas_data as nas` is all that a notebook needs; each name is imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from nas_data.environment_ids import register_when_loaded

if TYPE_CHECKING:
    from nas_data.api.evaluation import evaluate
    from nas_data.api.gap import identify
    from nas_data.api.importing import import_logs
    from nas_data.api.learned_model import LearnedModel
    from nas_data.api.pairing import pair
    from nas_data.api.policy import load_policy
    from nas_data.api.recording import record
    from nas_data.api.training import train_delta, train_forward
    from nas_data.dataset.dataset import Dataset
    from nas_data.errors import NasError
    from nas_data.gap.report import GapReport

__version__ = "0.1.0"
__all__ = [
    "Dataset",
    "GapReport",
    "LearnedModel",
    "NasError",
    "evaluate",
    "identify",
    "import_logs",
    "load_policy",
    "pair",
    "record",
    "train_delta",
    "train_forward",
]

HOMES = {
    "Dataset": "dataset.dataset",
    "GapReport": "gap.report",
    "LearnedModel": "api.learned_model",
    "NasError": "errors",
    "evaluate": "api.evaluation",
    "identify": "api.gap",
    "import_logs": "api.importing",
    "load_policy": "api.policy",
    "pair": "api.pairing",
    "record": "api.recording",
    "train_delta": "api.training",
    "train_forward": "api.training",
}  # name → module; type checkers read the imports above

if not TYPE_CHECKING:  # with `__getattr__`, a type checker would accept every other name as well

    def __getattr__(name: str) -> object:
        """Import a name on first use (PEP 562)."""
        if name not in HOMES:
            raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
        value = getattr(import_module(f"{__name__}.{HOMES[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Return all public names, imported or not."""
    return sorted({*__all__, *globals()})


register_when_loaded()
