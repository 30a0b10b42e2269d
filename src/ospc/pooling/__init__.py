"""Combine recordings of one camera: summaries, agreement, merging, and earlier calibrations as a start."""
