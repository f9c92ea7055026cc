"""Interface of arms of servos for recorders."""
