"""Baselines that are given the same blind cases: what other methods would have named."""
