"""Constants of the evaluation of calibrations: their meaning, unit and the reason for their value."""

# Errors of response and vignette (ospc.evaluation.metrics)

METRIC_GREYS = 256
"""Grey levels at which responses are compared."""
PROFILE_BINS, CENTRE_BINS = 50, 3
"""Bins of a radial profile, and number of bins at the centre, where a vignette is normalised."""
RANDOM_PAIRS = 20_000
"""Number of grey value pairs for the log-ratio error."""

# Comparison (ospc.evaluation.comparison)

MIN_COVERED_RADIUS = 0.1
"""Radius in half diagonals from which the uncertainty of a vignette is compared with its error: both are almost zero
near the centre, where V is 1 by definition."""
EXPONENT_RANGE = (0.1, 10.0)
"""Search range of the aligning exponent; no two camera responses differ by more."""
END_OF_RANGE = 1e-3
"""Distance from the ends of that range, in ln γ, below which it contains no minimum."""
RAMP_HEIGHT = 1e-12
"""Height of a ramp added to a power of g, so that values do not become equal by rounding."""

# Tracking of points (ospc.evaluation.lucas_kanade)

WINDOW_PX = 21
"""Side of the square tracking windows; OpenCV's default."""
TRACKING_LEVELS = 3
"""Levels of the image pyramid above the image itself; OpenCV's default."""
MAX_RETURN_PX = 1.0
"""Largest forward-backward error in pixels."""
MAX_MISMATCH = 0.5
"""Largest mean absolute difference of the two windows over the mean absolute deviation within them: the share of the
structure that the match does not explain."""
MIN_CONTRAST = 1e-9
"""Lower bound of the contrast, to keep the quotients of flat windows finite."""

# Improvement of tracking (ospc.evaluation.tracking)

NOTICEABLE_RATIO = 1.1
"""Ratio up to which a change counts as negligible."""

# Trajectories (ospc.evaluation.trajectory)

MIN_POSES = 3
"""Fewest poses that determine a similarity."""
COLLINEAR_RATIO = 1e-9
"""Ratio of singular values below which points are collinear, up to rounding."""
STAMP_TOLERANCE_S = 1e-3
"""Largest difference between the time stamps of a pose and its truth, in seconds."""

# Tracks in raw and corrected frames (ospc.evaluation.tracks)

MEDIAN_LOWEST, MEDIAN_HIGHEST, MEDIAN_BINS = 1e-5, 1e4, 4096
"""Range and number of the bins of the median; each is half a per cent wide."""
MIN_HEADROOM = 0.25
"""Smallest factor by which corrected frames are darkened; stronger vignettes are clipped in the corners."""
TRACKS_EVERY_FRAMES = 15
"""Interval, in frames, at which new tracks start."""
MAX_STARTED_TRACKS = 150
"""Most tracks that start in one frame."""
TRACK_HORIZON_FRAMES = 60
"""Frames after which a track is no longer followed; few points stay in view for longer."""
MAX_BRIGHTNESS_CHANGE = 0.5
"""Largest change of a window's mean grey level since its track began, in units of the contrast within it."""
CORNER_QUALITY, CORNER_DISTANCE_PX, CORNER_BLOCK_PX = 0.01, 10.0, 7
"""Corner detection: smallest corner strength relative to the best (Shi and Tomasi 1994), smallest distance between
points, and side of the block in which the strength is computed."""
