"""Constants of the default method's run and of change detection: what each is, its unit, and why."""

from __future__ import annotations

import numpy as np

# Images (ospc.methods.method)

MIN_SIDE_PX = 32
"""Shortest side of an image, in pixels, in which patches can be found again."""

# Quick fits during a run (ospc.methods.maximum_likelihood)

FIRST_QUICK_FIT_PAIRS = 16
"""Pairs before the first quick fit; the next follow whenever their number has doubled."""

REFERENCE_FIT_PAIRS = 64
"""Pairs after which a quick fit predicts new pairs well enough to notice a change of the camera."""

DROPPED_PAIRS = 32
"""The first so many pairs are dropped in the end: they were registered before the vignette was known."""

QUICK_FIT_POINTS = 5000
"""Scene points of a quick fit: enough for registration, which needs the vignette to a few per cent."""

QUICK_FIT_ROUNDS = 3
"""Rounds of a quick fit that starts from the one before."""

QUICK_FIT_RADIAL_TERMS = 5
"""Radial terms of its vignette: more would take longer to be known, and pairs registered until then are worse."""

MAX_VIGNETTE_SIGMA = 0.05
"""Standard deviation of the vignette at the corner, by chance, up to which frames are registered without it."""

MIN_MOVING_PAIRS, MOVING_FACTOR = 8, 4.0
"""Pairs, and times the displacement of a still camera, after which a camera counts as moving for good."""

UNDECIDED_PAIRS = 60
"""Pairs after which a camera that does not stand still counts as moving. Dark frames register badly at first."""

MAX_MOTIONS = 200
"""Latest displacements that tell whether the camera stands still."""

# Errors of prediction (ospc.methods.prediction_errors)

OUTLIER_ERROR_LOG = 0.3
"""Errors of prediction far beyond this, in ln, are moving objects or wrong registration."""

CHANGE_GREY_KNOTS = np.array([0.0, 0.15, 0.35, 0.6, 0.85, 1.0])
"""Grey levels between which a change of ln g is taken to be linear."""
CHANGE_GREY_KNOTS.setflags(write=False)

NO_CHANGE_POINTS = 1.0
"""Weight of the belief that nothing changed, in scene points: it keeps what no pair shows at zero."""

SEEN_QUANTILES = (0.02, 0.98)
"""Quantiles of grey levels and radii between which nearly all observations lie."""

# Whether the camera may have changed (ospc.methods.change_detection)

MIN_PAIR_POINTS = 40
"""Scene points of a pair below which its registration is not trusted."""

MAX_BASELINE_PAIRS = 480
"""Latest pairs of each kind whose errors are the baseline for outliers: a minute and a half or more of film at 20
frames/s."""

MIN_BASELINE_PAIRS = 12
"""Pairs in the baseline before one of their kind is an outlier."""

RECENT_PAIRS, OUTLIER_PAIRS = 8, 3
"""Of the latest so many pairs of a kind, so many must be outliers to raise a suspicion."""

OUTLIER_FACTOR = 4.0
"""Least error of an outlier over the median of the baseline; three in eight pairs exceed it when a lamp is switched,
too."""

MIN_BASELINE_ERROR_LOG = 0.001
"""Least value of that median, in ln: registration leaves as much."""

MAX_SUSPICION_S = 9.6
"""Time for which a suspicion is followed at most."""

JUDGED_S = 5.6
"""Latest time of a suspicion whose pairs are judged: light may have raised it before the camera changed."""

CALM_S = 4.8
"""Time without another suspicion after one that was followed to the end."""

MIN_FRAME_RATE, MAX_FRAME_RATE = 20.0, 100.0
"""Frames per second between which these times are counted in frames: slower film needs as many frames as that of 20
frames/s, and the pairs of more than 100 frames/s would be too many to judge."""

WATCHED_PAIRS, MIN_OUTLIER_SHARE = 32, 0.25
"""A suspicion ends early where fewer of the latest so many pairs of neighbours are outliers: the light changed."""

# Whether it has (ospc.methods.change_hypotheses)

MIN_SPAN_S = 3.0
"""Time that the pairs must span: light that changes is often steady again by then."""

MIN_HALF_PAIRS = 12
"""Pairs in each half by which a change is judged: what happens once is no change."""

MIN_EFFECT_LOG = 0.04
"""Smallest change, in ln of irradiance, that counts: a refocused lens changes the corners by more, drift by less."""

MIN_EXPLAINED_LOG = 0.005
"""Root mean square error within pairs, in ln, that a change must explain. Other responses, and corners that lose a
fifth, soon explained 0.0055 and more in simulated film; what only looked like a change explained 0.0047 at most."""

MIN_CORRELATION = 0.7
"""Correlation of the curves that both halves show; those of real changes had 0.87 and more."""

MIN_CHANGE_SIGMAS, MIN_HALF_SIGMAS = 12.0, 6.0
"""Standard deviations, by the scatter between pairs, that a change must exceed in all pairs and in each half. Real
changes of this size had 17 and 9 or more."""

SYSTEMATIC_LOG = 0.006
"""Standard deviation, in ln, by which registration is wrong in ways that pairs have in common."""

ALIKE_RATIO = 0.9
"""Ratio of what two explanations gain in pairs that they were not made from, or of the errors of whole pairs that
they leave, from which on one is as good as the other; both are named where they are so by both measures."""

MAJORITY = 0.8
"""Share of the pairs in each half that a change must explain, weighted by what it does to them: a few wrong
registrations prove nothing."""

MIN_EXPECTED_FACTOR = 3.0
"""Error that a change is expected to cause in a pair, over the median of the baseline, from which on the pair
counts."""

MIN_SIGNIFICANT_PAIRS = 6
"""Fewest such pairs in each half."""

LIGHT_SLOPE = -0.75
"""Slope of the error against the change of exposure from which on light that the exposure follows explains it: an
exposure control that keeps brightness constant shows a slope of −1."""

MIN_SLOPE = 0.15
"""Smallest change of that slope by another response."""

MIN_SLOPE_ERROR_LOG = 0.008
"""Median error of neighbours, in ln, below which the slope is not judged: clouds change light by less a frame."""

# When response and vignette are identifiable (ospc.methods.identifiability)

IDENTIFIABLE_ERROR, IDENTIFIABLE_CORNER_SIGMA = 0.005, 0.025
"""Limits of an identifiable curve: for the error of ratios of irradiance (κ), or of the profile of V, that is
exceeded in one of twenty cases, and for the standard deviation of ln V at the corner. In two of 55 recordings of all
kinds of cameras, with noise and unsteady light among them, κ was larger than stated; the error of V, in two of 33."""

UNIDENTIFIABLE_FACTOR = 8.0
"""Times these limits beyond which a curve is not identifiable: such errors are as large as what is corrected."""

MIN_SCATTER_GROUPS = 5
"""Comparisons of frames from which on their scatter tells how well a curve is known: with up to three, exposures off
by one or two per cent gave errors of 6 to 28 stated standard deviations, from about five on of 1.5 at most."""

DOUBTED_UNEXPLAINED_SHARE, CONTRADICTING_UNEXPLAINED_SHARE = 0.15, 0.5
"""Shares of a typical change of exposure that may be missing in the images: beyond the first the exposures are
doubted, beyond the second the response rests on nothing. Noise alone leaves less than a tenth."""

WIDE_EXPOSURE_RATIO = 8.0
"""Longest over shortest exposure from which on a wider range is no longer the first thing to ask for."""

MIN_COMPARED_LOG_K = 0.05
"""Change of ln exposure of a pair from which on its misfit is compared with it; below, noise is as large."""

# Tables of what observations cover (ospc.methods.coverage)

GREY_CLASSES, RADIUS_CLASSES, MAX_EXPOSURE_CLASSES = 32, 20, 16
"""Classes of grey level, of radius, and at most of ln exposure, in the tables: some pixels of a chart each."""

PLACE_COLUMNS = 16
"""Columns of cells into which the image is divided; cells are squares."""

MIN_CLASS_RESIDUALS = 10
"""Residuals of a class below which their quantiles say nothing."""

# The paper's method (ospc.methods.paper)

MAX_VIGNETTE_ROUNDS, VIGNETTE_TOLERANCE = 100, 1e-9
"""Most rounds of reweighting, and the relative change of the solution at which it has converged."""
