"""Benchmarks: speeds of two ways of the same work, and `blind`, which counts right names on sealed cases."""
