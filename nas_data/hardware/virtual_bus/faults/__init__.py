"""Faults of servos, wires and adapter, one file each."""
