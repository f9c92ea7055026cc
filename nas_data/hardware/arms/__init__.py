"""Arms of servos as recorders use them, whoever drives them."""
