"""Driver of arms with XL-320 servos on a serial port."""
