"""Gymnasium environments, plain and augmented: one file per task, registered under `nas/` (see `environment_ids`)."""
