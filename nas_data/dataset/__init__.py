"""Datasets in LeRobot v3 format: features, reading, writing, versions, provenance."""
