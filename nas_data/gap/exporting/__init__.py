"""Export of identified models to formats of other tools."""
