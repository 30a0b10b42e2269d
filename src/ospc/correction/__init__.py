"""Removes response and vignette from whole recordings."""
