"""Calibrate many recordings of many cameras in parallel, and merge the recordings of each camera."""
