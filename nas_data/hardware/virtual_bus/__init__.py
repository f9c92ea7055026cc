"""XL-320 servos that are simulated, on a pseudo-terminal that any Protocol 2.0 driver can open."""
