"""Neural-augmented robot simulation: paired recordings in, better simulators and transferable policies out."""

__version__ = "0.1.0"
