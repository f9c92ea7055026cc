"""Rollouts of policies on real arms, in the same tasks as in simulation."""
