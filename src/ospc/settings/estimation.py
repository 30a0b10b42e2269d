"""Constants of the default method's fit: what each is, its unit, and why it has this value.

"Chosen by hand" means that nothing but judgement stands behind a value. Where a range follows, the fit was repeated
with the two ends of it on six simulated recordings (200 frames of 480×360 pixels; six responses, three vignettes,
both noise levels, and one each with moving objects and with flicker). "No effect" means that the medians over them of
the response's shape error, κ and the vignette's error changed by less than 3 per cent; otherwise the change is
stated. "Raises the vignette error by half" and "raises κ by a quarter" mostly stand for one recording in which
another model of the vignette is chosen.
"""

from __future__ import annotations

# The response basis (ospc.estimation.response_basis)

RESPONSE_GRID_STEPS = 4096
"""Steps of the grid of grey levels on which the basis is tabulated: a sixteenth of an 8-bit grey level each, far
below any noise, so that the model can be linearised at the nearest grid point."""

QUADRATURE_POINTS = 4
"""Gauss-Legendre nodes in each step of the grid."""

FIRST_GRID_STEP_BEGINS = 0.25
"""Where the integral over the first step begins, in steps: ln g tends to minus infinity at black itself."""

TYPICAL_GAMMA_BLACK = 1.1
TYPICAL_GAMMA_RISE = 0.9
"""Typical local gamma at black, and its linear rise from black to white: they follow the medians over the 201
measured responses of Grossberg and Nayar (2003) up to grey level 0.8."""

# The vignette basis (ospc.estimation.vignette_basis, model_choice)

VIGNETTE_SIGMA = 2.0
"""Prior standard deviation of the vignette's first radial term, in ln V at the corner; that of the others decreases
with their order, see :data:`DARK_RADIUS`. Wide beside real lenses: cos⁴ at a half angle of 45° has a first
coefficient of -2. On 42 simulated recordings, 1 and 4 changed the mean vignette error by about a tenth."""

CENTRE_SIGMA, NON_RADIAL_SIGMA = 0.1, 0.1
"""The same of the centre along each axis, in half diagonals, and of the non-radial terms, in ln V: as much as lenses
have. A shift of the centre is nearly a sum of non-radial terms: with 2 for both, the centres of elliptic vignettes
that are off centre went up to 0.46 aside, and the RMSE of five such cameras was up to 0.23. Now it is at most
0.007."""

DARK_RADIUS = 1.2
"""Distance from the vignette's centre, in usable radii of the image, at which the prior lets V reach zero, as it does
where the image circle of a lens ends. The far corner is at 1.15 where the centre is off by 0.15. On 42 simulated
recordings, 28 of them off centre, 1.3 raised the error there from 1.25 to 1.7 standard deviations, and 1.1 the
vignette error of the centred ones by a tenth."""

ASYMMETRY_SIGMA = 0.0015
"""Asymmetry that registration errors common to all samples imitate, in ln V over a half diagonal. Added to the
covariance before a free centre or non-radial terms are accepted; of the centre, the shift that changes ln V as much
on average. Of 50 centred films and parts of films, one met the criterion by chance alone. With this they came to 0.8
of it at most, and vignettes off centre by 8 per cent of the half diagonal to nine times as much as it takes. With
0.004, a weak vignette off centre by 2 per cent stayed centred, and its profile was wrong by six standard
deviations."""

PROMISING_SHARE = 0.25
"""Share of that criterion which one step of Newton's method must meet, or else further parameters are not fitted: the
step takes a third of the time. It gave 0.5 to 0.7 of what the fit gave where that was near the criterion."""

FIRST_FIT_POINTS = 10_000
"""Scene points from which the first, approximate fit is made, to save time: it only starts the fit to all of them.
20000 has no harmful effect; 5000 raises the errors by a quarter to two thirds."""

MIN_CRITERION_GROUPS = 3
"""Pairs of frames that the criterion is computed for at least: the logarithm of one or two is no penalty."""

MIN_USABLE_RADIUS = 0.01
"""Smallest usable radius of a vignette, in half diagonals: a few pixels, which tell nothing of it."""

# The expected grey level (ospc.estimation.latent)

DARKEST_GREY = 0.25 / 255
"""Lowest grey level whose logarithm is used; darker ones are taken for this. A quarter of an 8-bit grey level. No
effect from 0.1 to 0.5 of an 8-bit grey level."""

MAX_DEVIATION_SIGMAS = 6.0
"""How far a predicted grey level may be from the measured one, in standard deviations: outliers must not move the
point of linearisation to where the response is quite another. 3 has no effect on the response; 12 raises κ by a
quarter and the vignette error by half."""

CONVEX_ROUNDS = 2
"""Rounds in which every scene point counts, without an earlier fit. The first is linearised at the measured grey
levels, whose noise makes gamma too small where most pairs have the same exposure. The other pairs, which tell the
response, would then be outliers. After a second round they are not."""

LATENT_ITERATIONS = 3
"""Rounds of predicting the grey levels from their point's mean and linearising anew. Chosen by hand: with 1, over 28
recordings, the error of the vignette is a fifth larger and that of the response's shape a sixth smaller."""

MIN_ONE_MINUS_LEVERAGE = 1e-3
"""Least value of one minus the leverage, by which residuals are divided. No effect from 1e-4 to 1e-2."""

PIXEL_NOISE_STRIDE = 16
"""The noise of single pixels is tabulated at every 16th point of the response's grid: at the 8-bit grey levels."""

# The shift of a mean of noisy pixels (ospc.estimation.mean_of_pixels)

SHIFT_LEVELS = 513
"""Grey levels at which the shift is computed, half an 8-bit grey level apart. No effect from 257 to 1025."""

SHIFT_QUANTILES = 65
"""Equally probable values that stand for the normal distribution of noise; odd, so that zero is one of them."""

UNCLIPPED_SIGMAS = 4.0
"""Distance from black and white, in standard deviations of the noise, from which on clipping does not change it. No
effect from 3 to 5."""

MIN_NOISE_LEVELS = 4
"""Fewest unclipped grey levels from which read and shot noise, two unknowns, are fitted."""

MIN_NOISE_IRRADIANCE = 1e-9
"""Least irradiance, as a share of saturation, used in that fit: where gamma is as steep as a step, next to none of
the grey levels below it mean any light. No effect from 1e-10 to 1e-7."""

# The error model (ospc.estimation.error_model)

START_GREY_SIGMA = 0.5 / 255
START_REGISTRATION_SIGMA_PX = 0.5
START_RADIANCE_SIGMA = 0.005
"""Errors assumed before any are fitted: half an 8-bit grey level, half a pixel, half a per cent of the radiance. The
second round of a fit already replaces them."""

GREY_CELLS = 8
GRADIENT_CELLS = 4
"""Quantiles of grey level and of gradient that make up the 32 cells over which squared residuals are summarised: five
coefficients are fitted to them. Chosen by hand; no effect from 6 to 12 cells of grey and with 6 of gradient, but 2 of
gradient raise the vignette error by half."""

MIN_PER_CELL = 40
"""Fewest observations whose median squared residual is used: its standard error is then 37 per cent. No effect from
20 to 80."""

MEDIAN_OF_SQUARED_NORMAL = 0.4549
"""Median of the square of a standard normal variable (chi-squared, one degree of freedom)."""

MIN_CELL_SIGMA = 0.02 / 255
"""Least standard deviation of a cell, in grey levels: keeps a cell of equal values from ruling the fit. No effect
from 0.01 to 0.05 of an 8-bit grey level."""

MIN_GREY_SIGMA = 0.05 / 255
"""Least constant error of the fitted model, in grey levels: no averaging over pixels is better than that. No effect
from 0.02 to 0.1 of an 8-bit grey level."""

MIN_RADIANCE_SIGMA = 1e-4
"""Least relative error of the radiance of the fitted model. No effect from 3e-5 to 1e-3."""

FACTOR_GREYS = (0.0, 0.03, 0.08, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.91, 0.95, 0.975, 1.0)
"""Grey levels at which the fitted law is corrected by a factor: denser near the ends, where noise is clipped."""

FACTOR_RANGE = (0.25, 25.0)
"""Least and largest of these factors of the variance. Chosen by hand; 0.5 to 5 has no harmful effect, 0.1 to 100
raises the vignette error by half."""

# The prior of the response (ospc.estimation.prior)

LEVEL_SIGMA = 0.6
"""Standard deviation of the logarithm of a camera's gamma about the typical one; two in three of the 201 measured
responses of Grossberg and Nayar (2003) lie within it."""

SLOPE_SIGMA = 1.0
"""Standard deviation of the slope of ln γ over the whole range of grey levels. 0.5 and 2 raise the shape error by a
tenth."""

SHOULDER_SIGMA = 0.5
"""Standard deviation of the change of ln γ between :data:`SHOULDER_GREY` and white, beyond what the curve does below;
two in three of the 201 measured responses lie between no change and a change by a factor of 2.6."""

SHOULDER_GREY = 0.75
"""Grey level above which that change takes place, linearly. Chosen by hand; 0.85 has no effect, 0.65 lowered κ by a
fifth on these six recordings."""

WHITE_SIGMA = 0.3
"""Standard deviation of what ln γ does besides in the last few grey levels. 0.42, nearer to the measured responses,
made the results of whole runs worse."""

BLACK_SIGMA = 0.2
"""Standard deviation of what ln γ does besides in the first few grey levels. Chosen by hand; 0.1 raises κ by a
quarter, 0.4 the shape error by a seventh."""

END_EXPONENT = 40
"""Power of the grey level (at black: of one minus it) with which these two variances fall off: they halve within 4.4
8-bit grey levels. Chosen by hand; 20 raises the shape error and 80 raises κ, both by a third."""

PRIOR_MIDDLE_GREY = 0.4
"""Grey level from which the random walks start, towards both ends. No effect from 0.3 to 0.5."""

PRIOR_NUGGET = 1e-6
"""Added to the variance of ln γ at each knot, so that its covariance can be inverted. No effect from 1e-7 to 1e-5."""

WALK_CANDIDATES = (0.03, 10.0, 11)
DRIFT_CANDIDATES = (0.3, 1.0, 3.0, 10.0, 30.0)
"""The hyperparameters to choose from, as standard deviations of ln γ over the whole range: of the random walk (least,
largest, number; equal ratios) and of the walk of the slope. They span a straight line to a kink at every knot."""

START_WALK = 1.0
START_DRIFT = 1.0
"""Hyperparameters before the first choice; that choice follows in the first round."""

# The fit (ospc.estimation.maximum_likelihood, fit)

MIN_GAMMA = 0.05
"""Least coefficient of the local gamma: keeps the response strictly increasing. Chosen by hand; no effect from 0.02
to 0.1."""

MAX_GAMMA_CHANGE = 3.0
"""Largest factor by which a coefficient changes in one round: the prior is linearised in its logarithm, which a
larger step leaves behind. 5 has no effect, 2 raises the vignette error by 15 per cent."""

MAX_DECENTRING = 0.5
"""Largest distance of the vignette's centre from that of the image, along each axis, in half diagonals. Lenses have
up to 0.1; where the exposures are wrong, the centre left the image and ln V overflowed."""

SETTLED_SIGMAS = 0.1
"""The rounds end when the parameters move less than this, as a root mean square in standard deviations. 0.03 has no
effect, 0.3 raises the shape error by a fifth."""

CHUNK_OBSERVATIONS = 4_000
"""Observations whose rows are built at once: about 1.2 MB, which bounds the memory of a fit and suits the cache."""

WEIGHT_SCALE_SIGMAS = 3.0
"""Scale of the redescending weight 1/(1 + (r/scale)²)² (Geman and McClure 1987), in robust standard deviations: an
observation at two standard deviations keeps about half of its weight. Chosen by hand; 2 raises the vignette error by
four fifths, 4 the shape error by a fifth."""

WEIGHT_CUT_SIGMAS = 4.5
"""Residual, in robust standard deviations, from which on an observation has no weight. Chosen by hand; 3.5 and 6
raise the shape error by 84 and 49 per cent."""

MIN_SANDWICH_FACTOR = 0.2
"""Least ratio of the mean derivative of the influence function to the mean weight: with many outliers it approaches
zero, and with it the information would. Chosen by hand; no effect from 0.1 to 0.4."""

CLEAR_OF_ENDS_SIGMAS = 2.0
"""Distance of the predicted grey level from black and white, in standard deviations of single pixels, below which an
observation is not used. Chosen by hand; no effect at 1, 3 raises the shape error by a tenth."""

MAX_TEXTURE = 0.3
"""Largest standard deviation of the pixels that are averaged, over their mean, whose effect is corrected in full:
except at knees, the correction is of second order. 0.2 and 0.5 change κ by less than a tenth."""

TEXTURE_WIDTHS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Standard deviations of texture, over the grey level, for which the mean of pixels at a knee is tabulated. The last
is beyond :data:`MAX_TEXTURE`; below the first, it is 1/10 000 of the mean."""

TEXTURE_SPREADS = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28)
"""The same of the irradiance, over it, for which that mean is computed. Local gammas from 0.5 to 4 turn them into
these widths."""

KNEE_LEVELS = 129
"""Grey levels at knees for which that is done; between them it is linear."""

MAX_NOISE = 0.2
"""Standard deviation of the noise of a pixel, over its grey level, at which half of that effect is corrected: more
noise leaves too little of the variance to texture. 0.05 gains a third as much for κ."""

TEXTURE_SHARE_INFORMATION = 2000.0
"""Precision of the expectation that all variance beside noise is texture, a share of one; an observation that texture
shifts by its standard deviation has a precision of one. In simulated recordings, where the share is one, the
observations alone gave -0.2 and 0.8 at precisions of 20 and 240, and 0.98 to 1.15 above 1400. With 300 instead of
2000, dark and noisy recordings gave 0 to 0.8, and κ was up to three times as large."""

MAX_RESPONSE_LEVELS = 4096
"""Most levels of the table of a response, one for each grey value of 12 bits: between them it is straight far within
its errors."""

MIN_RESPONSE_STEP = 1e-12
"""Least step of that table, as a share of g at white: near black, a gamma as steep as 20 is zero in floating point
for several levels, and a response has to increase."""

SUPPORT_QUANTILES = (0.002, 0.998)
"""Quantiles of the grey levels observed between which a response counts as measured: single outliers measure
nothing."""

RATIO_DARKEST_GREY, RATIO_BRIGHTEST_GREY = 15 / 255, 245 / 255
RATIO_LOG_GREY_SPREAD = 0.3
"""Grey levels whose ratios of irradiance are judged, and the standard deviation of the log ratio of two of them: what
a direct method compares. The ends of a response are hardly ever measured."""

RATIO_LEVELS, RATIO_PARTNERS, PROFILE_POINTS = 93, 4, 50
"""Grey levels at which the error of such ratios is predicted, three to an interval between knots; grey levels that
each of them is compared with; and radii at which the error of the vignette is predicted."""

CONFIDENCE, ERROR_DRAWS = 0.95, 256
"""Probability that an error is not larger than stated, and number of sets of parameters drawn from their covariance:
other draws change the error stated by a twentieth."""

UNRESOLVED_JUMP = 1 / 12
"""Standard deviation of ln g for a jump of γ by one within an interval of ln M of length one, where γ is fitted by a
straight line. The error is 1/8 at a jump in the middle, and less elsewhere."""

BEND_SMOOTHING = 0.06
"""Standard deviation, in grey levels, of the smoothing of γ before its slope is taken. Without it, the correction for
texture follows the errors of the estimate: κ of one recording in ten gets two to ten times worse."""

KNEE_SMOOTHING = 0.015
"""The same at knees, where the mean over a normal distribution is taken instead: half an interval between knots. For
five recordings of a camera with knees, the error of ln g(0.75)/g(0.25) is 0.006 at most; 0.008 when half as wide, and
0.012 when twice as wide. Above :data:`SHOULDER_GREY`, it made the shape in a real video four times worse."""

KNEE_BEND = 3.0
"""Least part of g″/g′ that the wider smoothing takes away at a knee; grey levels run from 0 to 1. Without a knee it
was 2.4 at most, in 34 simulated recordings and a real video; with one it was 14 to 29."""

MAX_DARK_CLEARANCE = 0.1
"""Largest grey level that is left out at the dark end for that reason. Chosen by hand; no effect from 0.05 to 0.2."""

GROUPS_PER_BLOCK = 12
"""Most consecutive pairs of frames whose scores are added before their scatter is measured: neighbouring pairs show
the same scene and share its errors. Chosen by hand; no effect from 6 to 24 on recordings this short."""

MIN_BLOCKS = 16
"""Fewest such blocks, if there are as many pairs: the standard error of a variance from 16 is already 37 per cent. 32
has no effect, 8 raises the vignette error by half. Bands of fewer groups are at least those of independent errors."""

DISAGREEMENT_SHARE = 1.0
"""Weight of what halves of the observations disagree by beyond chance, beside the scatter between groups of pairs.
When it was 0.3 of all disagreement, chance included, bands were a fifth too wide: 71 instead of 83 per cent of the
vignette's profile are within one standard deviation of the truth now in 28 simulated recordings."""

# Effects beside response and vignette (ospc.estimation.effects)
#
# Each has three standard deviations: in cameras that have the effect, in cameras where it goes unnoticed, and of what
# clean recordings imitate. The second was chosen by hand. The third is about a quarter of the largest values in 47
# clean simulated recordings, none of which is significant then.

BEYOND_WHITE = 0.6
"""Mean irradiance of white pixels less that at white, over that at white: their grey level hides how bright they are,
and glare comes from them too. It was 0.3 to 0.9 in eight simulated recordings. With zero, glare of 2 per cent
was found as 2.5, as if bright frames had more of it than they have light."""

LIGHT_FIT_FLOOR = 0.1
"""Irradiance, over that at white, from which on the powers of the grey level follow g in proportion to its size, and
below which errors of any size count alike: few surroundings are darker. Without it, the error of dark ones is three
times as large for the simulator's filmic response."""

GLARE = (0.03, 0.03, 0.0005)
"""Veiling glare, as a share of the frame's mean irradiance. All lenses have some, most 1 to 5 per cent."""

SCATTER = (0.03, 0.03, 0.003)
"""Light scattered nearby, as a share of the irradiance there, in all lenses. Registration errors at edges look
a little like it."""

DARK_CURRENT = (0.03, 0.005, 0.001)
"""Dark signal of a typical exposure, as a share of the irradiance at white."""

OFFSET = (0.1, 0.001, 0.001)
"""Constant error of all exposures, as a share of a typical one: 25 µs at 5 ms is common, and 5 µs goes unnoticed.
With 0.1 for the second, exposures with random errors of 1 per cent gave bands four times as wide as the errors. With
0.005, 82 per cent of the response's shape were within one standard deviation in 28 clean recordings, 79 with this."""

LATENESS = (0.3, 0.03, 0.01)
"""Frames by which all exposures are late, after those of a whole number have been moved: stamped, interpolated or
averaged exposures are."""

MOST_LATE_FRAMES = 1.0
"""Largest of these: more is moved by whole frames."""

LOCAL_TONE = (0.1, 0.0, 0.005)
"""Exponent by which bright surroundings brighten a place; negative where they darken it. Tone mapping that people
notice has -0.1 or more; equalisation within tiles of the image had 0.2. Clean recordings had 0.003 on average, and
0.013 at most."""

CURVATURE = (0.3, 0.0, 0.002)
"""Curvature of ln exposure by its stated value: logarithms of exposures have some 0.4."""

RESPONSE_DRIFT = (0.1, 0.0, 0.003)
"""Half the change of ln γ from the first to the last group."""

BLACK_DRIFT = (0.1, 0.0, 0.0005)
"""Half the change of the black level over white."""

BLACK_BY_EXPOSURE = (0.1, 0.0, 0.0005)
"""Rise of the black level over white where the exposure is e times as long. In 97 simulated recordings it was 3.2
standard deviations at most, and 5.6 or more where the gain raised the black level by 0.008 of white."""

VIGNETTE_DRIFT = (0.1, 0.0, 0.002)
"""Half the change of ln V at the corner, or at a side in half a diagonal. Over the latter, clean recordings had 1.7
standard deviations at most."""

MAX_ADDED_SHARE = 0.9
"""Largest share of the light at a place that may be added: keeps the logarithm finite on the way to the solution."""

MIN_EXPOSURE_FACTOR = 0.1
"""Smallest true exposure over the stated one, for the same reason."""

DARKEST_IRRADIANCE = 1e-3
"""Least irradiance, over that at white, that additional light is compared with: what is darker counts as so bright.
Below the black level of limited-range video g is next to nothing, and single samples would decide."""

# Which effects count (ospc.estimation.model_choice)

SUSPECTED_SIGMAS = 1.5
"""Standard deviations from which on an effect is fitted with everything else. One step towards it tells little: the
effect itself adds to the scatter by which it is judged."""

ABSORBED_FRAME_LIGHT, ABSORBED_NEARBY_LIGHT, ABSORBED_DARK = 0.35, 0.5, 0.25
"""Quantiles of the additional light of all observations that the response holds while effects are fitted: of the
light of frames, of surroundings, and of the dark signal. With halves, grey levels with less light than that had none
left: with a dark signal of 0.012 of white, ln g at grey 30 was off by 0.6, now by 0.02, and glare of 0.03 in a room
was not found. The smaller they are, the more slowly fits converge: with the least of all, they ended at a glare of
0.03 instead of 0.05, and with a quarter at 0.07 of light scattered nearby instead of 0.1."""

SUSPECTED_LIGHT_SIGMAS = 2.0
"""The same for added light, by chance alone. Near black, ln g is so far from linear in it that one step may go only a
tenth of the way: of a dark signal of 0.008 of white it showed 0.0008 ± 0.0004, and the vignette was off by 0.009."""

MIN_GROUPS = 30
"""Fewest pairs of frames from which effects are judged. Of 170 parts of 45 to 90 pairs of clean simulated recordings,
and of 60 whole ones with 39 to 120 pairs, none showed any."""

MOST_ADDED_LIGHT, MOST_OFFSET = 0.1, 0.3
"""Largest additional light and offset of the exposures that lenses, sensors and shutters have: more has another
cause."""

SIGNIFICANT_SIGMAS = 5.0
"""Standard deviations, by chance and by what clean recordings imitate, from which on the fitted effect counts."""

SIGNIFICANT_SIGMAS_IN_ALL = 3.0
"""The same with what halves of the observations disagree on."""

CONTRADICTING_SIGMAS = 8.0
"""Standard deviations, by chance and by what clean recordings imitate, from which on a contradiction counts whatever
the halves disagree on: gentle tone mapping had 10, clean recordings 4 at most."""

EFFECT_PROBABILITY, CONTRADICTION_PROBABILITY = 0.3, 0.02
"""Probability, before any observation, that a camera has an effect that matters, and that a recording has something
that contradicts the model: few recordings are tone mapped. How much an effect that is left out widens the uncertainty
follows from them. With 100 pairs, an effect of 2.5 standard deviations, by chance and by what clean recordings
imitate, counts half, and a contradiction of 3.5: clean recordings had 4 at most. With 0.5 instead of 0.3, an offset
of 2.2 standard deviations in a short recording without any left its response marginal. With 0.1 instead of 0.02,
tone mapping of 1.7 standard deviations widened the band of a real video without any by half."""

PREFERRED_SHARE = 0.9
"""Significance, over that of the clearest effect, from which on one of a camera is tried before a contradiction: an
offset of the exposures is also a curvature of their logarithm."""

# Whether the vignette is smooth (ospc.estimation.residual_effects)

UNEVEN_CELLS = (16, 12)
"""Cells of the image, across and down; each square of four is a part that is compared: about as large as dirt."""

UNEVEN_FEWEST = 60
"""Fewest observations in a part that is judged."""

UNEVEN_FEWEST_BLOCKS = 3
"""Fewest blocks of pairs that have some: of two, the scatter is hardly known."""

UNEVEN_SYSTEMATIC = 3e-4
"""Standard deviation of ln L that errors common to all pairs add to the mean of a part."""

UNEVEN_GROUPS_PER_BLOCK = 3
"""Most consecutive pairs whose residuals in a part are added before their scatter is measured: a part is seen for a
moment only, and more would leave too few blocks."""

UNEVEN_SIGMAS = 4.5
"""Normal deviate of the mean of a part from which on the vignette is uneven. In 33 clean simulated recordings and a
real video, 2.8 was the largest of all parts. In single cells it was 4.0, and a smudge that takes three fifths of the
light had 4.4 there, but 5.4 in four: places on its slopes are not flat, and few are sampled."""

# Whether response and vignette are the same in all frames (ospc.estimation.residual_effects)

UNSTEADY_FEWEST_POINTS = 20
"""Fewest scene points of a pair whose slope is judged."""

UNSTEADY_SPREAD = 0.1
"""Least standard deviation between them of ln M, or of the place in half diagonals: a slope needs a range."""

UNSTEADY_FEWEST_PAIRS = 30
"""Fewest such pairs: the scatter of 30 slopes is known to an eighth."""

UNSTEADY_SIGMAS = 3.5
"""Scatter of the slopes between pairs, in standard deviations by the scatter inside them, from which on response or
vignette are unsteady. Registration and moving objects add to it: 67 clean simulated recordings had 3.0 at most over
ln M and 2.4 over the place. Two exponents a fifth apart had 3.4 to 9, automatic contrast 3 to 16, electronic
stabilisation 2.2 to 8.6."""

UNSTEADY_SLOPE = 0.01
"""Least standard deviation of the slope between pairs that matters, in ln L over ln M or half a diagonal."""

GAIN_SIGMAS = 3.0
"""Standard deviations by which the scatter of the mean residuals of pairs must exceed what chance explains, before
pairs of frames have latent gains. By independent errors of the points it was at most as large as that in 23 of 24
clean simulated recordings, 2.5 times in a real video, and 5 to 18 times with clouds, flicker or drifting white
balance."""

MOST_LOG_GAIN = 10.0
"""Largest latent gain, in ln, a factor of twenty thousand: more only comes of a senseless response, and would
overflow."""

EXCEPTIONAL_SIGMAS = 2.5
"""Standard deviations from what all other pairs say, beyond which the gain of a pair is exceptional: a frame whose
exposure is wrong, a light that is switched. Its variance is then set so that it is no farther away. Of normal
gains, one in eighty is exceptional."""

GAIN_MEMORIES = (3.0, 10.0, 30.0, 100.0)
"""Times over which gains of frames change, in frames. A mixture of them and of independent gains comes near to
flicker, white balance and clouds alike. What changes more slowly is hardly seen between the frames of a pair."""

PAIRS_PER_GAIN_BLOCK = 256
"""Pairs whose gains are correlated at most. They reach over many times the longest memory, and matrices stay small in
runs of hours."""

EXCEPTIONAL_ITERATIONS, VARIANCE_ITERATIONS = 3, 3
"""Iterations of the weights of exceptional pairs, and of the variances of gains, in each round of a fit."""

MOST_RADIANCE_SIGMA = 0.04
"""Relative standard deviation of the radiance of a place between frames, beyond noise, from which on one response
and one vignette do not explain the images. It was 0.01 at most in 39 clean simulated recordings, 0.005 in a real
video, with crowds and with glossy surfaces, and 0.07 to 0.09 with contrast equalised in tiles."""

# How sure exposure ratios are (ospc.methods.summary)

MISREGISTERED_SPREAD = 3.0
"""Scatter of a pair's points, over that of typical ones, from which on the frames were not registered: of such pairs
two thirds are wrong by more than a tenth. No effect from 2 to 6."""

MISREGISTERED_SIGMAS = 2.0
"""Their standard deviation over that scatter: the points are wrong alike, so that their number does not help."""
