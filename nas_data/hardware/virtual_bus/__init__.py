"""Simulated servos on a pseudo-terminal, which any driver of their protocol can open."""
