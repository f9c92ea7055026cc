"""Networks that no longer learn, stepped once for all rows of a batch: one way to do it a file."""
