"""Where trials run: one file a place, `local` or a cluster."""
