"""Edits of a model that several effects share; no effect itself."""
