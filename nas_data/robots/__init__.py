"""Robots: one file each, with MJCF models of this project and cited constants."""
