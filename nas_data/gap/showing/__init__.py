"""Figures and HTML page of a gap report, from its files alone."""
