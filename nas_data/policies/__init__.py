"""Policies: PPO training, evaluation on a target, comparison of methods."""
