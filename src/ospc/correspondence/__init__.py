"""From frames to correspondences: which pairs, which points, and their grey values."""
