"""Constants of what the residuals of a fit reveal: their meaning, unit and the reason for their value.

"Chosen by hand" and "no effect" are explained in :mod:`ospc.settings.fit`.
"""

# Smoothness of the vignette (ospc.estimation.residual_effects)

UNEVEN_CELLS = (16, 12)
"""Number of image cells, across and down. Each square of four cells, about as large as dirt, is one tested part."""
UNEVEN_FEWEST = 60
"""Minimum number of observations in a tested part."""
UNEVEN_FEWEST_BLOCKS = 3
"""Minimum number of blocks of pairs with observations in the part: the scatter of two is hardly known."""
UNEVEN_SYSTEMATIC = 3e-4
"""Standard deviation of ln L that errors common to all pairs add to the mean of a part."""
UNEVEN_GROUPS_PER_BLOCK = 3
"""Maximum number of consecutive pairs whose residuals in a part are added before their scatter is measured: a part is
visible only briefly, and longer blocks would be too few."""
UNEVEN_SIGMAS = 4.5
"""Normal deviate of the mean of a part above which the vignette is uneven. In 33 clean simulated recordings and a
real video, the largest of all parts was 2.8, but 4.0 in single cells. A smudge that absorbs three fifths of the light
had 5.4, but 4.4 in single cells, because few points on its slopes are flat enough to be sampled."""
REJECTED_SCALES = 3.0
"""Median residual of a cell, in units of the scatter of all residuals, above which the fit rejects a part of the
image instead of explaining it. In 97 clean recordings, the largest of all cells was 1.9. It was 4 to 76 with a hood,
a finger or dirt that darkens a corner, or 4 % in the middle, by a tenth to two thirds."""
REJECTED_TYPICAL_SCALES = 8.0
"""The same for the median absolute residual: points that move into a dark part and out of it have residuals of both
signs. It was at most 7.2 in these recordings, 12 with a drop on the lens, and 9 and 24 with a hood along one side
that takes a third or two thirds of the light."""
REJECTED_NOISE_SIGMAS = 2.0
"""Median absolute residual of such a cell, in standard deviations by the error model, that noise does not explain. It
is 0.7 by chance. In clean recordings whose dark cells were rejected by the two limits above, because noise is larger
there than elsewhere, it was at most 1.2; with hoods, fingers, straps and dirt that were, it was 3.2 to 69."""
REJECTED_FEWEST = 15
"""Minimum number of observations in such a cell, whose median is then known to a third of that scatter. Few remain
where something dark covers the scene, because its edges are not registered: 25 with a drop on the lens, 15 with dirt.
In 97 clean recordings, the largest median was 2.5 and the largest median absolute residual 7.2 from cells with 15."""

# Constancy of response and vignette (ospc.estimation.residual_effects)

UNSTEADY_FEWEST_POINTS = 20
"""Minimum number of scene points of a pair for estimating its slope."""
UNSTEADY_SPREAD = 0.1
"""Smallest standard deviation of these points' ln M, or position in half diagonals: a slope needs a range."""
UNSTEADY_FEWEST_PAIRS = 30
"""Minimum number of such pairs: the scatter of 30 slopes is known to an eighth."""
UNSTEADY_SIGMAS = 3.5
"""Scatter of the slopes between pairs, relative to their standard errors, above which response or vignette are
unsteady. Registration and moving objects add to it. With points of equal weight, it was at most 3.0 over ln M and
2.4 over the position in 67 clean simulated recordings, 2.5 in 180 of another renderer, 3.4 to 9 with two exponents a
fifth apart, 3 to 16 with automatic contrast, and 2.2 to 8.6 with electronic stabilisation; but 4.4 to 5.1 in three
clean recordings that were short, dark and noisy. With points weighted by their errors, it is at most 3.1 in these."""
UNSTEADY_SLOPE = 0.005
"""Smallest standard deviation of the slope between pairs that matters, in ln L per ln M or per half diagonal. It was
0.0076 in two recordings with sun outside the view, in which V was wrong by up to 0.008 and 0.017."""
MAX_UNSTEADY_UNRESOLVED = 0.01
"""Observations at grey levels where bends that the basis does not resolve make ln g uncertain by more than this are
not used. The error at such bends grows with the exposure ratio, so the slopes of pairs differ: with the simulator's
``tum_narrow`` and noise, they scattered by 8 and 9 standard errors, and by 1.0 and 1.1 without these observations."""
GAIN_SIGMAS = 3.0
"""Number of standard deviations by which the scatter of the pairs' mean residuals must exceed chance before frames
get latent gains. Relative to independent errors of the points, it was at most 1 in 23 of 24 clean simulated
recordings, 2.5 in a real video, and 5 to 18 with clouds, flicker or drifting white balance."""
MIN_TAIL_SCALE = 2.5
"""Standard deviation of pairs' mean residuals, estimated from their 95 per cent quantile, relative to chance, from
which frames get latent gains, too. If exposures in coarse steps are stated inexactly, the response can fit most of
them; the pairs with the others are far off, and their points count as outliers. It was at most 1.4 in 60 clean
simulated recordings, 2.0 with sharp bends of the response and noise, and mostly 3 to 20 with errors of 1 per cent."""
MOST_LOG_GAIN = 10.0
"""Largest latent gain, in ln, a factor of twenty thousand: a degenerate response would make it overflow."""
EXCEPTIONAL_SIGMAS = 2.5
"""Number of standard deviations from the prediction of all other pairs beyond which the gain of a pair is
exceptional, such as a frame with a wrong exposure or a light that is switched. Its variance is then increased until
it is exactly this far away. One in eighty normally distributed gains is exceptional."""
GAIN_MEMORIES = (3.0, 10.0, 30.0, 100.0)
"""Correlation times of the frames' gains, in frames. A mixture of these and of independent gains approximates
flicker, white balance and clouds; slower changes are hardly visible between the frames of a pair."""
GAIN_KINDS = len(GAIN_MEMORIES) + 2
"""Number of kinds of gains: independent ones, those of each memory, and those that recur with the exposure."""
PAIRS_PER_GAIN_BLOCK = 256
"""Maximum number of pairs whose gains are correlated. They span many times the longest memory, and matrices stay
small in runs of hours."""
EXCEPTIONAL_ITERATIONS, VARIANCE_ITERATIONS = 3, 3
"""Iterations for the weights of exceptional pairs, and for the variances of gains, per round of a fit."""
MOST_RADIANCE_SIGMA = 0.04
"""Relative standard deviation of a point's radiance between frames, beyond noise, above which one response and one
vignette do not explain the images. It was at most 0.01 in 39 clean simulated recordings, 0.005 in a real video, with
crowds and with glossy surfaces, and 0.07 to 0.09 if contrast was equalised in tiles."""

# Pairs that were registered wrongly (ospc.estimation.wrong_pairs, ospc.methods.exposure_ratios)

MISREGISTERED_SPREAD = 3.0
"""Scatter of a pair's points, relative to typical pairs, above which the frames count as misregistered: two thirds of
such pairs are wrong by more than a tenth. In 22 recordings without repetitive texture the largest was 2.3, on regular
facades up to 33."""
AGREEING_SHARE = 0.3
"""Scatter of a pair's points, relative to their common residual, up to which they agree that the exposures of the
pair are wrong. Linearised this far from the stated exposures, the residuals scatter by up to 15 %; in
misregistered pairs, the scatter exceeds what the points have in common."""
MISREGISTERED_FEWEST_POINTS = 30
"""Minimum number of points for judging a pair by its scatter, which is then known to a fifth."""
MISREGISTERED_ITERATIONS = 3
"""Iterations for the robust weights of these points."""
USUAL_PAIRS = 0.25
"""Quantile of the pairs' scatter that counts as usual: on a facade, more than half of the pairs may be wrong."""
MISREGISTERED_SIGMAS = 2.0
"""Standard deviation of such a pair's exposure ratio, as a multiple of that scatter: the points share one error, so
their number does not reduce it."""

# Pairs whose exposures are wrong (ospc.estimation.wrong_pairs)

MAX_WRONG_PAIRS_SHARE = 0.25
"""Largest share of the pairs that contradict the exposures of the others. If there are more, the others are doubtful,
too. With one exposure in seventeen wrong, it was up to a sixth."""
RATIO_CELLS = (4, 3)
"""Number of image cells, across and down, within which the points of a pair may have errors in common. In twenty
simulated recordings, eleven of them of scenes with occlusions and gloss, 72, 95 and 99.3 per cent of the errors of
exposure ratios are within one, two and three standard deviations; with independent points it was 66, 88 and 95. With
3×2 to 8×6 cells it is 70 to 72, 93 to 96 and 98 to 99."""
