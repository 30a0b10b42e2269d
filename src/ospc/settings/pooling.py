"""Constants of the combination of recordings and of cameras: their meaning, unit and the reason for their value."""

import numpy as np

# Summaries of recordings (ospc.pooling.summary)

SUMMARY_RESPONSE_INTERVALS, SUMMARY_RADIAL_TERMS = 48, 16
"""Number of intervals between the knots of the response, and of knots of the vignette, in summaries: those of the
default settings, so that usually nothing is lost."""

# Agreement of recordings (ospc.pooling.agreement)

COMPARED_GREYS = np.array([0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9])
"""Grey levels at which ln g is compared, relative to :data:`NORMALISING_GREY`. The ends are omitted because they
follow the prior."""
NORMALISING_GREY = 0.5
"""Grey level at which the curves are normalised, because the scale of g is a convention. Most recordings cover it."""
COMPARED_RADII = (0.4, 0.7, 1.0)
"""Radii at which ln V is compared, in half diagonals; closer to the centre it is almost zero for any lens."""
COMPARED_DIRECTIONS = 8
"""Directions in which ln V is compared at each radius, so that a shifted centre is noticed."""
ALLOWED_SCATTER = {"response": 0.02, "vignette": 0.01}
"""Standard deviation, in ln, of the scatter between recordings of one camera beyond their stated uncertainty: other
scenes and lighting lead to other registration errors. It only decides what is merged at all: differences within it
widen the result."""
DIFFERING_SIGMAS = 5.0
"""Difference above which a recording differs: the largest of 32 values is tested, and errors are not quite normal. In
51 pairs of simulated recordings of one camera, in 36 of them with only 15 to 60 frames in one, it was 3.8 at most."""
SUSPICIOUS_FACTOR = 4.0
"""Ratio to the usual unexplained share of exposure changes above which exposures are suspected to be wrong."""
MIN_USUAL_UNEXPLAINED = 0.005
"""Smallest unexplained share that counts as usual, for recordings with nearly perfect exposures."""
MAX_AGREEMENT_ROUNDS = 10
"""Most rounds of comparing with the recordings that agree. The set of differing recordings usually settles after two
or three rounds, but may alternate."""
SCATTER_CHANCE_SIGMAS = 2.0
"""Standard deviations by which the mean square difference between recordings may exceed its expectation, 1, by
chance. Only what exceeds this counts as scatter: 3.8 for two recordings. In fifteen pairs of simulated recordings of
one camera, it was 1.3 at most; in 36 pairs with only 15 to 60 frames in one, 4.2 at most."""

# The pool (ospc.pooling.pool)

FREE_PRECISION = 1e-4
"""Precision of each parameter of a free part: a standard deviation of 100, far beyond any value, but not singular."""

# The solution (ospc.pooling.solution)

MAX_SOLUTION_ROUNDS = 12
"""Most rounds of linearising the prior; a few are usual, and only contradictory information needs more."""
SOLUTION_TOLERANCE = 1e-3
"""Squared change of the parameters, in standard deviations, at which the rounds end: far below their errors."""

# Calibrations as summaries (ospc.pooling.calibration_summary)

MIN_RELATIVE_INFORMATION = 1e-9
"""Smallest relative information in any direction: subtracting a prior may otherwise make it negative by rounding."""
MIN_OBSERVED = 0.05
"""Information on a direction of the vignette, relative to that of the prior, below which it counts as unobserved:
rounding and disagreement between halves would otherwise look like an observation that contradicts the prior."""
OMITTED_SIGMA = 0.003
"""Standard deviation, around zero, of vignette parameters that a calibration omits: it would have included larger
ones, and the centre if it is uncertain."""
MAX_RESPONSE_KNOTS = 1025
"""Most knots of a response that are accepted, far more than any method has."""
MAX_WALK = 1e3
"""Largest accepted hyperparameters of a prior: a hundred times those of any fit."""

# The cameras of a rig (ospc.pooling.rig)

MAX_MOMENTS = 24
"""Maximum number of moments compared, spread over the recordings. Features take most of the time, and
:data:`SYSTEMATIC_SIGMA` limits the benefit of more moments."""
MAX_RIG_FEATURES = 1500
"""Maximum number of features per image: matching time grows with their square, and with fewer, small overlaps have
no matches."""
LONGEST_SIDE_PX = 800
"""Longest side of the images in which features are detected: finer structure takes time and matches less reliably."""
MATCH_RATIO = 0.8
"""Largest ratio of the distances to the nearest and second nearest descriptor, as recommended by Lowe (2004)."""
MIN_MATCHES = 20
"""Minimum number of matches at a moment: a fundamental matrix takes eight, and fewer than this agree by chance."""
MAX_EPIPOLAR_PX = 1.5
"""Largest distance of a match from its epipolar line, in reduced pixels: lens distortion is not corrected."""
EPIPOLAR_CONFIDENCE = 0.999
"""Probability that RANSAC draws at least one sample without wrong matches."""
RIG_SMOOTHING_PX = 2.0
"""Standard deviation of the smoothing of irradiance, in reduced pixels: features lie on structure, and their
positions are uncertain by about a pixel."""
DARKEST_RIG_GREY, BRIGHTEST_RIG_GREY = 4 / 255, 247 / 255
"""Grey levels beyond which a pixel counts as clipped: noise is clipped there, and responses are least certain."""
MAX_CLIPPED_SHARE = 0.01
"""Largest weight of clipped or masked pixels in a smoothed value."""
STRETCHED_QUANTILES = (0.02, 0.98)
"""Quantiles of ln irradiance that become black and white of the image in which features are detected, so that a lamp
or a dark corner in one view does not change the contrast of the rest."""
MAX_GAP_S = 0.02
"""Largest difference, in seconds, between time stamps of the same moment: little moves in this time."""
ERROR_OF_MEDIAN = 1.2533
"""Ratio of the standard errors of median and mean for a normal distribution: √(π/2)."""
MIN_MOMENTS_FOR_SPREAD = 3
"""Minimum number of moments for measuring their spread."""
SYSTEMATIC_SIGMA = 0.005
"""Standard deviation of ln s in addition to that of the matches: radiance depends on the viewing direction."""
