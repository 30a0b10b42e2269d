"""Constants of the check of a recording: their meaning, unit and the reason for their value."""

# Notes on a recording (ospc.diagnosis.check)

MANY_CLIPPED_SHARE = 0.10
"""Share of clipped pixels that justifies a note: windows and lamps clip in any recording, but cover less of it."""
DARK_CORNER_SHARE = 0.05
"""Share of well-exposed pixels in the outermost ring below which the vignette in the corners is extrapolated."""
WEAK_SLOPE = 0.15
"""Median d ln M/d ln e below which brightness hardly follows the exposure: a third of the slope for gamma 2.2."""
SLOWEST_VIDEO_S = 0.7
"""Longest interval between frames of a video, in seconds. Photographs taken one by one are further apart and have no
frame rate that could show dropped frames."""

# Dropped frames (ospc.diagnosis.report)

GAP_RATIO = 1.5
"""Interval over the median interval above which frames are missing: midway between one and two, because stamps
jitter."""
