"""Actuators for models that have none, importable by scripts."""

from nas_data.mjcf.default_servos import add_position_servos, add_torque_motors

__all__ = ["add_position_servos", "add_torque_motors"]
