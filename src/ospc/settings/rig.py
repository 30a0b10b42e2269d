"""Constants of the comparison of the cameras of a rig: their meaning, unit and the reason for their value."""

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
