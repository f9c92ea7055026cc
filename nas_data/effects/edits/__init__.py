"""Edits of a model that several effects share."""
