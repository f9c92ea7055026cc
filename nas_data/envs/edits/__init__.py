"""Model edits of dynamics beyond effects, one per file."""
