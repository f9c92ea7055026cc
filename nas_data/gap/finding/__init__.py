"""Location of the gap: comparison of model and recording by joint and condition."""
