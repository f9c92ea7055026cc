"""Policies on real arms: the same tasks, with servos in place of a simulation."""
