"""Baselines that get the same blind cases: effects that other methods would name."""
