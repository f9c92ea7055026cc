"""Series of simulated servos, one file each: control table and physical meaning of its registers."""
