"""Where model and recording disagree."""
