"""Excitations: command signals that make a robot show its dynamics, one file each."""
