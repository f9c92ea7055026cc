"""The simulated servos, one file a series: control table, and what its registers mean in physics."""
