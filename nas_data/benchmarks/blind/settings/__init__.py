"""Settings of the blind benchmark: each file draws arms, recordings and hidden effects of its own kind."""
