"""Plants that stand in for a robot: what hides in them is told to nobody, and they share no code with `effects/`."""
