"""Constants of the combination of recordings: their meaning, unit and the reason for their value."""

import numpy as np

# Summaries of recordings (ospc.pooling.summary)

SUMMARY_RESPONSE_INTERVALS, SUMMARY_RADIAL_TERMS = 32, 16
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
scenes and lighting lead to other registration errors."""
DIFFERING_SIGMAS = 5.0
"""Difference above which a recording differs: the largest of 32 values is tested, and errors are not quite normal."""
SUSPICIOUS_FACTOR = 4.0
"""Ratio to the usual unexplained share of exposure changes above which exposures are suspected to be wrong."""
MIN_USUAL_UNEXPLAINED = 0.005
"""Smallest unexplained share that counts as usual, for recordings with nearly perfect exposures."""
MAX_AGREEMENT_ROUNDS = 10
"""Most rounds of comparing with the recordings that agree. The set of differing recordings usually settles after two
or three rounds, but may alternate."""
MIN_RECORDINGS_FOR_SCATTER = 4
"""Fewest agreeing recordings whose scatter is measured; with fewer, it is too uncertain to be used."""

# The pool (ospc.pooling.pool)

FREE_PRECISION = 1e-4
"""Precision of each parameter of a free part: a standard deviation of 100, far beyond any value, but not singular."""
ROUGH_VIGNETTE_WALK = 1.0
"""Hyperparameter ``vignette_walk`` of typical mechanical vignetting: what it leaves unknown was not observed."""

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
