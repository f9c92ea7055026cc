"""What a dynamics changes in a model beyond effects: one kind of change a file."""
