"""Constants of runs and change detection: their meaning, unit and the reason for their value."""

import numpy as np

from ospc.arrays import read_only

# Images (ospc.methods.method)

MIN_SIDE_PX = 32
"""Shortest image side, in pixels, for which patches can be matched."""

# Quick fits during a run (ospc.methods.maximum_likelihood)

FIRST_QUICK_FIT_PAIRS = 16
"""Number of pairs before the first quick fit; further ones follow whenever it has doubled. While there is none, it is
tried again after as many pairs: an epoch may begin with 80 or 150 pairs, and no change can be detected without it."""
REFERENCE_FIT_PAIRS = 64
"""Number of pairs after which a quick fit predicts new pairs well enough to detect a change of the camera."""
DROPPED_PAIRS, PAIRS_PER_DROPPED = 32, 4
"""Number of first pairs that the final fit omits, and fewest pairs for each of them: they were registered before the
vignette was known, but a short recording needs them."""
INTER_CODED_SIGMAS = 2.0
"""Factor on all standard deviations of videos with inter-frame compression. Where brightness changes little, their
frames keep that of the previous one, so neighbouring places and consecutive frames have errors in common. In eleven
codings of simulated recordings as H.264 (crf 16 to 23) and MPEG-4, the exponent of the response was off by 1.3
standard deviations (root mean square; up to 2.5) without this factor, and by 1.0 in nine lossless ones. Unless it
also counts in the significance of effects, clean H.264 seems to be tone mapped or to change its black level."""
NEAR_WHITE = 32 / 255
"""Distance from white within which grey levels of frames are forgotten if white was not known then: the mean over a
partly clipped place is at most about this far below it if the place is flat."""
QUICK_FIT_POINTS = 5000
"""Scene points of a quick fit: enough for registration, which needs the vignette to within a few per cent."""
QUICK_FIT_ROUNDS = 3
"""Rounds of a quick fit that starts from the previous one."""
QUICK_FIT_RADIAL_TERMS = 10
"""Number of knots of the vignette in a quick fit. With 5 or 16, frames of one simulated recording were registered
worse, so that it needed 125 pairs instead of 108; with 8, a real video seemed to have local tone mapping. The centre
is free if the observations support it: where a steep vignette is decentred, registration with a centred one is biased
in the far corner."""
MAX_VIGNETTE_SIGMA = 0.05
"""Frames are registered with the vignette of the quick fit once its standard deviation at the corner, by chance, is
below this."""
MIN_MOVING_PAIRS, MOVING_FACTOR = 8, 4.0
"""Number of pairs, and displacement relative to the limit for a stationary camera, after which a camera permanently
counts as moving."""
MOVING_SHARE = 0.15
"""Share of pairs with such a displacement from which a camera is not stationary although most pairs show no motion: a
pan-tilt unit in steps. Misregistered pairs of a stationary camera are fewer or less displaced."""
MIN_FAR_PAIRS, FAR_MOTION = 2, 0.05
"""Number of pairs, and displacement relative to the longer side of the image, after which a camera has certainly
moved, however rarely. In seven recordings of a stationary camera, two of them very dark and noisy, the largest was
0.03."""
UNDECIDED_PAIRS = 60
"""Pairs after which a camera that is not stationary counts as moving. Dark frames register poorly at first."""
MAX_MOTIONS = 200
"""Number of latest displacements that determine whether the camera is stationary."""

# Prediction errors (ospc.methods.prediction_errors)

OUTLIER_ERROR_LOG = 0.3
"""Prediction errors far beyond this, in ln, are moving objects or wrong registrations."""
CHANGE_GREY_KNOTS = read_only(np.array([0.0, 0.15, 0.35, 0.6, 0.85, 1.0]))
"""Grey levels between which a change of ln g is interpolated linearly."""
NO_CHANGE_POINTS = 1.0
"""Weight of the prior that nothing changed, in scene points: it keeps unobserved parts at zero."""
SEEN_QUANTILES = (0.02, 0.98)
"""Quantiles of grey level and radius between which nearly all observations lie."""

# Suspected changes of the camera (ospc.methods.change_detection)

MIN_PAIR_POINTS = 40
"""Minimum number of scene points of a pair for its registration to be trusted."""
MAX_BASELINE_PAIRS = 480
"""Number of latest pairs of each kind whose errors form the baseline for outliers: at least a minute and a half of
video at 20 frames/s."""
MIN_BASELINE_PAIRS = 12
"""Minimum number of pairs in the baseline before a pair of that kind can be an outlier."""
RECENT_PAIRS, OUTLIER_PAIRS = 8, 3
"""A suspicion is raised if, of this many latest pairs of a kind, this many are outliers."""
OUTLIER_FACTOR = 4.0
"""Minimum error of an outlier, relative to the median of the baseline. When a lamp is switched, three in eight pairs
also exceed it."""
MIN_BASELINE_ERROR_LOG = 0.001
"""Lower limit of that median, in ln: registration alone leaves this much."""
MAX_SUSPICION_S = 9.6
"""Maximum duration of a suspicion, in seconds."""
JUDGED_S = 5.6
"""Latest seconds of a suspicion whose pairs are judged: light may have raised it before the camera changed."""
JUDGED_AGAIN_POINTS = 200
"""Most scene points of each pair that are kept to judge it again with a complete fit. The scatter between pairs
decides, so more would only take memory."""
CALM_S = 4.8
"""Time, in seconds, without another suspicion after one that reached its maximum duration."""
MIN_FRAME_RATE, MAX_FRAME_RATE = 20.0, 100.0
"""Range of frames per second in which these times are converted to frames: slower video needs as many frames as at 20
frames/s, and above 100 frames/s there would be too many pairs to judge."""
WATCHED_PAIRS, MIN_OUTLIER_SHARE = 32, 0.25
"""A suspicion ends early if, of this many latest pairs of neighbours, less than this share are outliers: the light
changed."""

# The first frame of a change (ospc.methods.change_detection)

LOCATED_S = 30.0
"""Seconds before a suspicion that are searched for the first frame of the change: as long as two suspicions of the
longest duration and the calm between them."""

# Confirmed changes of the camera (ospc.methods.change_hypotheses)

MIN_SPAN_S = 3.0
"""Minimum time, in seconds, spanned by the pairs: changing light is often steady again by then."""
MIN_HALF_PAIRS = 12
"""Minimum number of pairs in each half for judging a change: a single event is not a change."""
MIN_EFFECT_LOG = 0.04
"""Smallest change, in ln of irradiance, that counts: refocusing a lens changes the corners by more, drift by less."""
MAX_STATED_EFFECT_LOG = 1.0
"""Size of a change, in ln, up to which it is stated: a larger one is extrapolated to corners that hardly any point
shows."""
MIN_EXPLAINED_LOG = 0.005
"""Root mean square error within pairs, in ln, that a change must explain. In simulated video, other responses and
corners that lose a fifth soon explained at least 0.0055, and spurious changes at most 0.0047."""
MIN_CHANGE_SHARE = 0.03
"""The same, relative to the size of the change: a change much larger than the errors that show it is extrapolated. It
was 0.037 or more for ten changes of response or vignette in simulated video, and 0.02 in one without a change, whose
views hardly moved vertically: their errors seemed to show a tilt of ln V by 0.3."""
MIN_SHARE_BEYOND_LIGHT = 0.02
"""Share of the squared errors explained by a change that light added to single frames must leave to it. In simulated
video, it was 0.10 to 0.37 for changes of response or vignette and 0.07 for a black level that rose by 3 % of white
after the response. With veiling glare of 8 and 10 % for six seconds, with a sun that passed, and with a black level
that rose before the response, it was at most 0.0005."""
MIN_CORRELATION = 0.7
"""Minimum correlation between the change curves of both halves; those of real changes had at least 0.87."""
MIN_CHANGE_SIGMAS, MIN_HALF_SIGMAS = 12.0, 6.0
"""Standard deviations, from the scatter between pairs, that a change must exceed in all pairs and in each half. Real
changes of this size had at least 17 and 9."""
SYSTEMATIC_LOG = 0.006
"""Standard deviation, in ln, of registration errors that pairs have in common."""
ALIKE_RATIO = 0.9
"""Two explanations are equally good if the ratio of their gains in pairs not used to fit them, or of the errors they
leave in whole pairs, exceeds this; both are reported if this is so by both measures."""
COMPARABLE_RATIO, CLEARLY_WORSE_FACTOR = 0.5, 3.0
"""An explanation with at least this share of the other's gain is preferred if the other leaves more than this
multiple of its errors in whole pairs. With glare, darker corners had 0.75 to 0.84 of the gain of another response,
which left 6 to 13 times their errors."""
MAJORITY = 0.8
"""Share of the pairs in each half that a change must explain, weighted by its effect on them: a few wrong
registrations prove nothing."""
MIN_EXPECTED_FACTOR = 3.0
"""Minimum error that a change is expected to cause in a pair, relative to the median of the baseline, for the pair to
count."""
MIN_SIGNIFICANT_PAIRS = 6
"""Minimum number of such pairs in each half."""
LIGHT_SLOPE = -0.75
"""Slope of the error against the change of exposure below which changing light, followed by the exposure, explains
it: auto exposure that keeps brightness constant has a slope of −1."""
MIN_SLOPE = 0.15
"""Minimum change of that slope that indicates another response."""
MIN_SLOPE_ERROR_LOG = 0.008
"""Median error of neighbours, in ln, below which the slope is not judged: clouds change light by less per frame."""

# Epochs between changes (ospc.engine.state)

MAX_EPOCH_CALIBRATIONS = 8
"""Number of ended epochs whose calibrations are kept. Each takes about 65 kB of memory and of every saved state: with
a zoom lens, keeping all would add megabytes every hour. Only the latest one is used again."""
COMMON_POWER_GREYS, COMMON_POWER_TOLERANCE, COMMON_POWER_SIGMAS, MIN_COMMON_POWER_LOG = 32, 0.05, 3.0, 0.1
"""Number of grey levels at which the responses before and after a change are compared; difference of the powers of
response and vignette, and misfit of the response's, up to which both are one power; factor on the standard deviation
of the vignette's, which is added; and least ln of such a power. Exposures without a gain that follows them had powers
of 0.667 and 0.668; another response had 0.60 and 1.00."""

# Identifiability of response and vignette (ospc.methods.identifiability)

IDENTIFIABLE_ERROR, IDENTIFIABLE_CORNER_SIGMA = 0.005, 0.025
"""Limits for an identifiable curve. The first applies to the error of irradiance ratios (κ) and of the profile of V
that is exceeded in one case in twenty, the second to the standard deviation of ln V at the corner. In 55 recordings
of all kinds of cameras, some with noise and unsteady light, κ exceeded the stated error in two; in 33, the error of V
did in two."""
UNIDENTIFIABLE_FACTOR = 8.0
"""A curve is not identifiable beyond this multiple of these limits: such errors are as large as the correction."""
MAX_CORNER_ERROR_SHARE = 0.3
"""Share of |ln V| up to which the standard deviation of ln V at the corner alone leaves a vignette marginal, beyond
that multiple. It matters for V below 0.51. With V of 0.09 in one corner, which was hardly observed, the standard
deviation was 0.55 there, and V was known to within one per cent everywhere else. Chosen by hand."""
MIN_SCATTER_GROUPS = 5
"""Minimum number of frame comparisons for their scatter to show the accuracy of a curve. With up to three, exposures
off by one or two per cent gave errors of 6 to 28 stated standard deviations; from about five on, at most 1.5."""
DOUBTED_UNEXPLAINED_SHARE, CONTRADICTING_UNEXPLAINED_SHARE = 0.15, 0.33
"""Shares of a typical change of exposure that may be missing in the images. Beyond the first, the exposures are
doubted; beyond the second, the response has no basis. Noise alone leaves less than a tenth. With exposures averaged
over nine frames, 0.44 were missing, and κ was 0.16 at a stated 0.03."""
CLIPPED_OBSERVATIONS_SHARE = 0.2
"""Share of observations at white beyond which unexplained exposures are put down to them: a clipped grey level does
not change with the exposure. Fits with fewer were right; from a third on, some
failed."""
CLEARLY_BETTER_CORRELATION = 0.15
"""Increase of the correlation between changes of grey level and of exposure beyond which exposures of a neighbouring
frame, or inverse ones, are named as the reason for unexplained exposures. Unrelated exposures reached 0.1."""
WIDE_EXPOSURE_RATIO = 8.0
"""Ratio of the longest to the shortest exposure beyond which a wider range is no longer advised."""
POSSIBLE_LIGHT_SIGMAS = 2.0
"""Standard deviations beyond which uncorrected scattered light is stated as the reason for an uncertain response: a
fisheye and a wet lens had 2.2 to 3."""
ONE_WAY_SHARE = 0.9
"""Change of ln exposure from the first frame to the last, as a share of the sum of all changes, from which the advice
is to raise and lower the exposure several times. It is 1 if the exposure only rises, and 0 if it falls as much."""
FAR_RADIAL_MOTION = 0.2
"""Radial motion, in half diagonals, beyond which more motion is no longer advised: the fifth that is asked for."""
ONE_DIRECTION_RATIO = 4.0
"""Ratio of the uncertainties of the vignette's centre across and along the motion, above which motion in the other
direction is advised. It was at most 2.7 with hand-held cameras and forward motion, and 4 to 30 with cameras that only
panned or moved sideways."""
MIN_COMPARED_LOG_K = 0.05
"""Minimum change of ln exposure of a pair with which its misfit is compared; below it, noise is as large."""

# Coverage tables (ospc.methods.coverage)

GREY_CLASSES, RADIUS_CLASSES, MAX_EXPOSURE_CLASSES = 32, 20, 16
"""Numbers of classes of grey level and of radius, and maximum number of classes of ln exposure, in the tables: each
is a few pixels wide in a chart."""
PLACE_COLUMNS = 16
"""Number of columns of square cells into which the image is divided."""
MIN_CLASS_RESIDUALS = 10
"""Minimum number of residuals of a class for meaningful quantiles."""
RESIDUAL_DECIMALS = 6
"""Decimals of these quantiles: a millionth of the radiance is far below any error, and keeps files short."""

# The paper's method (ospc.methods.paper)

MAX_VIGNETTE_ROUNDS, VIGNETTE_TOLERANCE = 100, 1e-9
"""Maximum number of reweighting rounds, and relative change of the solution at which it has converged."""
ZERO_RESIDUAL = 1e-6
"""Residuals below this count as zero, relative to their scale: they would get an infinite weight."""
CONSTRAINT_WEIGHT = 1e4
"""Weight of the equation Σc = 1 relative to all others if c ≥ 0 is enforced: the solution fulfils it to within 1e-8,
and no digits are lost."""
MONOTONICITY_LEVELS = 1024
"""Number of grey levels between which a polynomial has to increase: far more than it has bends."""
MIN_POLYNOMIAL_IRRADIANCE = 1e-6
"""Lower limit of the irradiance before taking its logarithm: below the first grey level of any camera."""
RADIAL_MOTION_QUANTILE = 0.9
"""Quantile of the radial displacements of a pair that counts as its radial motion: the largest ones may be wrong
matches."""
MAX_CORRECTED_EXPOSURES = 256
"""Maximum number of corrected exposures that a calibration states. Others are interpolated, which is exact for a
constant offset; cameras whose exposures are thirds of a stop have at most 40."""
MIN_NOTED_GAIN = 0.001
"""Smallest random gain of frames or exposures, as a share, that a note mentions: smaller ones, of which a clean
recording showed 0.00009, matter to nobody. They are accounted for all the same."""
