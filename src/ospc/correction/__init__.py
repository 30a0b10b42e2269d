"""Photometric correction of entire recordings."""
