"""Robots: one file each, MJCF written by us with cited constants."""
