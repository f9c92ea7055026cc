"""Excitations: command signals that excite the dynamics of a robot, one file each."""
