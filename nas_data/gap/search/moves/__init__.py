"""The moves of the search: each file is one kind of step from one hypothesis to a better one."""
