"""What can go wrong with servos, wires and adapter: one file a fault."""
