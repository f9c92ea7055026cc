"""The demo: a small run of recording, gap, policies and page, in minutes."""
