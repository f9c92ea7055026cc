"""What can be learned from a subset: one file a kind."""
