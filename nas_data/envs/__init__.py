"""Gymnasium environments, plain and augmented, single and batched."""
