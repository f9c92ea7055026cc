"""Speeds as ratios: two ways of the same work, timed in turns within one run."""
