"""The search for effects: guesses, fits, choices."""
