"""Ablations: accuracy of φ, ψ and named effects against amount of data, over seeds."""
