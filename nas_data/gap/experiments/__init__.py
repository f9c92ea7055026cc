"""What to record next, where two names cannot be told apart."""
