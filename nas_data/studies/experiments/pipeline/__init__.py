"""Shared parts of the experiments: recordings, models, named effects, policies, the authors' numbers."""
