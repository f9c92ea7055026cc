"""Physics engines behind one interface: reset, step, predict, roll out."""
