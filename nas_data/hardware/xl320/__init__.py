"""XL-320 servos on a serial port: the driver of arms that they move."""
