"""Executors of trials, one per file: `local` or a cluster."""
