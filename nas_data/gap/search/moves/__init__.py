"""Moves of the search; each file is one kind of step from a hypothesis to a better one."""
