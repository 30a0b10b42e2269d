"""Constants of live calibration: their meaning, unit and the reason for their value."""

import numpy as np

# Advice on what to film (ospc.live.advice)

HOLD_S, PATIENCE_S, SET_ASIDE_S = 3.0, 12.0, 20.0
"""Times in seconds: how long an instruction stays at least, unless another is urgent, since nobody can follow faster
changes; after how long an instruction without effect gives way to the next best; how long it is then excluded."""
MIN_CAPTURED_PAIRS = 64
"""Fewest pairs of frames before the capture can be done: the first ones were registered without knowing the vignette,
and their common errors do not appear in any standard deviation."""
BETTER_GAIN_RATIO = 1.3
"""Ratio of gains at which another instruction replaces the current one."""
FOLLOWED_GAIN_SHARE = 0.8
"""Share of its first gain below which an instruction counts as followed: the gain shrinks towards the goal."""
EXPOSURE_STEP = 1.5
"""Exposure ratio of a hypothetical pair: the change within a second when turning from a wall to a window."""
TARGET_GREYS = np.linspace(0.05, 0.95, 19)
"""Grey levels of hypothetical points, spaced like the knots of the response."""
SHOWN_GREYS = 0.1
"""Distance from such a grey level to the ends of the range that the page marks around it."""
DARK_GREY, BRIGHT_GREY = 0.25, 0.7
"""Grey levels that points only reach in brighter surroundings (below the first) or darker ones (above the second)."""
TARGET_RADII = (0.0, 0.3, 0.6, 0.9)
"""Radii of hypothetical points in half diagonals; points beyond 0.9 are rarely matched."""
TYPICAL_GREY = 0.4
"""Grey level of hypothetical moving points: the usual target of auto exposure."""
OUTER_RADIUS = 0.6
"""Radius beyond which a point counts as near a corner, to find the corner that has been seen least."""
LATEST_PAIRS, FEW_POINTS = 16, 12.0
"""Number of latest pairs considered, and points per pair below which the camera moves too fast; about a hundred are
usual."""
MIN_LOG_EXPOSURE_RANGE = 0.4
"""Range of ln exposure below which the exposure counts as constant: a factor of 1.5."""

# What is known so far (ospc.live.knowledge)

GOAL = 0.005
"""Root mean square error of g and V over all grey levels and radii at which a capture is complete: direct odometry
does not benefit from smaller errors."""
ASSESSED_GREYS = np.linspace(0, 1, 65)
"""Grey levels at which the uncertainty of the response is evaluated; dense enough for its 49 knots."""
INFORMATION_POINTS = 3000
"""Scene points used for the information matrix: a representative sample that takes 25 ms."""
EXPECTED_PAIR_POINTS = 100
"""Scene points of a hypothetical pair of frames: half of what a typical pair provides."""
EXPECTED_GRADIENT = 0.003
"""Grey gradient of a hypothetical point, in full scale per pixel: half of what counts as flat."""

# Estimates during a run (ospc.live.status)

FIRST_ESTIMATE_FRAMES, ESTIMATE_GROWTH = 48, 4
"""Number of processed frames before the first automatic estimate, and factor by which that number grows from one
estimate to the next: with a factor of 2, they took a quarter of the processor time of the first half minute."""
UNKNOWN_GROWTH = 1.5
"""That factor while something is not identifiable. With a factor of 4, the status was outdated for half a minute,
because few frames are processed late in a run."""
CONFIRMING_FRAMES = 12
"""Number of processed frames before the next estimate if quick estimates indicate that the goal is reached."""
LATEST_FRAMES, MAX_UNUSABLE_FRAMES = 20, 10
"""Number of latest frames considered, and number of unusable ones among them above which the advice says so: a driver
that starts or hesitates loses fewer."""

# Replays of recordings (ospc.live.capture)

LONGEST_GAP_S = 10.0
"""Longest time between frames that a replay waits for, in seconds of the recording: longer gaps are pauses of the
camera or steps of its clock."""
