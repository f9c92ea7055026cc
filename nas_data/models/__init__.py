"""Learned models φ and ψ, their trivial baselines, training and checkpoints."""
