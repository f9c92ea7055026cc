"""Neural-augmented robot simulation: paired recordings in, better simulators and transferable policies out."""

from nas_data.environment_ids import register_when_loaded

__version__ = "0.1.0"

register_when_loaded()
