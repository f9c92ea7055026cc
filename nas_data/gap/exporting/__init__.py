"""Identified models as parameters that others read."""
