"""Correspondences: selection of frame pairs and scene points, and their grey values."""
