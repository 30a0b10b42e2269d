"""Constants of brightness changes between frames: their meaning, unit and the reason for their value."""

import numpy as np

from ospc.arrays import read_only

# Changes of brightness between two frames (ospc.exposures.brightness)

GREY_BIN_EDGES = read_only(np.array([0.05, 0.09, 0.14, 0.20, 0.27, 0.35, 0.44, 0.54, 0.65, 0.78, 0.93]))
"""Edges of the grey bins: the same change of exposure changes ln M differently at different grey levels. Bins are
narrower where responses are steeper; black and white, where noise is clipped, are excluded."""
MIN_BIN_PIXELS = 40
"""Minimum number of points for a bin's mean or for the median motion: the standard error is a sixth of the scatter.
With fewer, one moving object would dominate; with more, small images would leave bins empty."""
MAX_BIN_WEIGHT = 5000.0
"""Most points that a bin counts as; otherwise one large uniform surface, whose errors share a cause, would
dominate."""
MAX_RELATIVE_GRADIENT = 0.04
"""Largest relative gradient (gradient over grey level, per thumbnail pixel) of a flat point. A registration error of
a tenth of a pixel then changes ln M by at most 0.004; a lower limit would leave too few points in textured scenes."""
BIN_OUTLIER_SIGMAS = 2.5
"""Points further from their bin's median than this, in robust standard deviations, are excluded from its mean: moving
objects, gloss, wrong registrations. This keeps 99 per cent of normally distributed values."""
MIN_BIN_SCATTER_LOG = 1e-4
"""Minimum scatter assumed in a bin, in ln of the grey level: keeps rounding errors of nearly equal values."""
PIXEL_SAMPLES_PER_PAIR = 400
"""Approximate number of points kept per pair: about thirty in each cell of the local tone mapping check."""
MOTION_STRIDE = 5
"""The motion is measured at one in this many points: neighbours move alike, so more cost time and add nothing."""
MIN_MOTION_GRADIENT = 0.01
"""Minimum gradient, in full scale per thumbnail pixel, of a point whose displacement is measured: at flatter points,
registration interpolates from the surroundings."""

# Selection of brightness changes (ospc.exposures.brightness_series)

AR_ORDER = 2
"""Order of the autoregressive noise: neighbouring pairs share a frame, and registration errors swing back."""
MIN_PAIR_WEIGHT = 100.0
"""Minimum number of points for a pair of frames to be used: fewer often share one error, on a moving object."""
MAX_BIN_DEVIATION_LOG = 0.02
MAX_BIN_DEVIATION_SHARE = 3.0
"""A bin is used if it differs from the middle bin by no more than the sum of both, in ln of the grey level: a
constant for registration errors, and a multiple of the middle change because the slope of a response varies this much
between bins."""

# Number of brightness changes kept (ospc.exposures.brightness_history)

MAX_BRIGHTNESS_CHANGES = 1200
"""Maximum number of brightness changes kept: computing the likelihood of a lag then takes a tenth of a second."""
MAX_REPEATED_FRAMES = 1000
"""Maximum number of repeated frames whose numbers are kept: enough to inspect, however long the run."""

# Unexplained brightness changes (ospc.exposures.brightness_report)

NOTABLE_RMS_LOG = 0.006
"""Root mean square of the unexplained change of ln brightness per frame up to which nothing is doubted: registration
alone leaves this much."""
DRIFT_FRAMES = 40
"""Number of frames over which unexplained changes are added up: auto exposure acts within this time, and
registration errors do not yet add up to much."""
DRIFT_STEP_FRAMES = DRIFT_FRAMES // 4
"""Number of frames between the starts of these windows, which overlap so that no swing is cut in two."""
UNCHANGED_EXPOSURE_LOG = 1e-4
"""Change of ln exposure up to which it counts as unchanged: rounding in files, but no step that a camera makes."""
STALE_DRIFT_LOG = 0.12
"""Drift of ln brightness above which an exposure that never changes counts as stale, however small each step is:
within `DRIFT_FRAMES`, auto exposure changes it by more, registration errors by less."""
MIN_STALE_PAIRS = 12
"""Fewest pairs of unchanged exposure for it to count as stale: their root mean square is known to a fifth."""
EXPLAINED_POINTS = 0.9
"""Share of the scene points in pairs of frames whose exposure ratios a fit must explain to within `NOTABLE_RMS_LOG`
for exposures not to be stale or to fit badly: with extreme film responses it explained this share to within 0.005, on
regular facades to within 0.002, with stale exposures to within 0.04 at best."""
EXPLAINED_SIGMAS = 2.0
"""The same in standard deviations of the ratio of a pair, if these are larger. By noise alone, one pair in twenty
exceeds it."""
REPORTED_FLICKER_SHARE = 0.6
"""Minimum share of the fast unexplained changes for a flicker to be reported: more than :func:`find_flicker`
requires, because a false report would send the user looking for a lamp."""
REPORTED_FLICKER_TOTAL_SHARE = 0.4
"""Minimum share of the variance of all unexplained changes for a flicker to be reported. The slow swings of a control
loop also have a strongest frequency, but with a smaller share."""
HARMONIC_TOLERANCE_TURNS = 0.1
"""Deviation from a whole number of turns per cycle of exposures up to which a flicker is a harmonic of the cycle."""
RMS_KEPT_SHARE = 0.98
"""Share of the changes, the smaller ones, used for a root mean square: a scene cut is no change of light."""
JUMP_SIGMAS = 10.0
"""Minimum size of a jump, in robust standard deviations of the unexplained changes. Failed registrations and moving
objects give them heavy tails, so a few standard deviations are common."""
MIN_JUMP_LOG = 0.04
"""Minimum size of a jump, in ln of the grey level: smaller ones are not worth reporting even without noise."""
JUMP_FRAMES = 4
"""Frames before and after a jump within which it must not be reversed: a passing hand takes longer than one."""
CONTRADICTING_JUMP_LOG = 0.1
"""Size of a jump, in ln of the grey level, from which it contradicts the recorded exposures: a gain of about a fifth.
In 266 recordings with right exposures, four had jumps of 0.04 to 0.09, due to registration."""
MIN_JUMP_SAMPLES = 100
"""Scene points of a pair of frames, of at most 400, from which the pair alone shows a jump. In 200 recordings, wrong
registrations with errors of more than 0.1 had at most 16 points."""
CONTRADICTING_PAIR_LOG = 0.05
"""Size of such a jump, in ln irradiance, from which it contradicts the recorded exposures. In 129 recordings with
right exposures, one pair was off by more than ten standard deviations, by 0.016."""
MODERATE_JUMP_LOG = 0.7
"""Size of a jump, in ln, up to which it is stated in per cent: a factor of two."""
LASTING_JUMP_SHARE = 0.6
"""Share of a jump that must remain over these frames: noise and drift over a few frames remove less than the rest."""
MAX_JUMPS_SHARE = 0.1
"""Share of pairs with jumps above which none is reported: jumps are then the rule, and the exposures do not fit."""
