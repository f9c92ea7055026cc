"""Plants that stand in for a robot, with hidden effects; they share no code with `effects/`."""
