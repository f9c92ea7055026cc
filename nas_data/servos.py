"""Actuators for models that have none, under the name by which scripts import them."""

from nas_data.mjcf.default_servos import add_position_servos, add_torque_motors

__all__ = ["add_position_servos", "add_torque_motors"]
