"""Recorders: they turn a simulated target, a robot or a recorded log into a dataset."""
