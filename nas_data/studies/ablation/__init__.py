"""Ablations: how good φ, ψ and named effects get with how much data, over seeds."""
