"""Evaluate calibrations."""
