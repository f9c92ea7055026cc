"""The demo: record, learn the gap, learn policies, show; everything once, small, in minutes."""
