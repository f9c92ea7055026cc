"""Inference of trained networks, one control step for a batch of rows: one backend per file."""
