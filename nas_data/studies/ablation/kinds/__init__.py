"""Kinds of predictors, one per file."""
