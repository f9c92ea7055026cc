"""What cases of the blind benchmark look like: each file draws arms, recordings and hiding places of its own sort."""
