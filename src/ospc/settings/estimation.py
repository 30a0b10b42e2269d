"""Constants of the default method's fit: their meaning, unit and the reason for their value.

"Chosen by hand" means that a value rests on judgement alone. Where another value is mentioned, the fit was repeated
with it on six simulated recordings (200 frames of 480×360 pixels; six responses, three vignettes, both noise levels,
one with moving objects and one with flicker). "No effect" means that the median response shape error, κ and vignette
error changed by less than 3 per cent; otherwise the change is given. "Raises the vignette error by half" and "raises
κ by a quarter" are mostly due to one recording for which a different vignette model is selected.
"""

from __future__ import annotations

# The response basis (ospc.estimation.response_basis)

RESPONSE_GRID_STEPS = 4096
"""Number of steps of the grey-level grid on which the basis is tabulated. A step is a sixteenth of an 8-bit grey
level, far below any noise, so the model can be linearised at the nearest grid point."""

QUADRATURE_POINTS = 4
"""Number of Gauss-Legendre nodes per grid step."""

FIRST_GRID_STEP_BEGINS = 0.25
"""Start of the integral over the first grid step, in steps: ln g tends to minus infinity at black."""

TYPICAL_GAMMA_BLACK = 1.1
TYPICAL_GAMMA_RISE = 0.9
"""Typical local gamma at black, and its linear rise from black to white. They follow the medians of the 201 measured
responses of Grossberg and Nayar (2003) up to grey level 0.8."""

# The vignette basis (ospc.estimation.vignette_basis, model_choice)

VIGNETTE_SIGMA = 2.0
"""Prior standard deviation of the slope of ln V in R² at the centre; further out it increases, see
:data:`DARK_RADIUS`. This is wide compared to real lenses: cos⁴ at a half angle of 45° has a slope of -2. On 42
simulated recordings, 1 and 4 changed the mean vignette error by about a tenth."""

CENTRE_SIGMA, NON_RADIAL_SIGMA = 0.1, 0.1
"""Prior standard deviations of the vignette's centre along each axis, in half diagonals, and of the non-radial terms,
in ln V: as large as in real lenses. A shift of the centre is nearly a sum of non-radial terms; with 2 for both, the
centres of decentred elliptic vignettes were wrong by up to 0.46 and the RMSE of five such cameras reached 0.23. With
these values it is at most 0.007."""

DARK_RADIUS = 1.2
"""Distance from the vignette's centre, in usable radii of the image, at which the smooth part of the prior lets V
reach zero, as V does at the edge of the image circle. The far corner is at 1.15 if the centre is off by 0.15. With
powers of R² instead of a spline, on 42 simulated recordings, 28 of them decentred, 1.3 raised the error of these from
1.25 to 1.7 standard deviations, and 1.1 raised the vignette error of the centred ones by a tenth."""

VIGNETTE_WALK_CANDIDATES = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Candidate standard deviations of the random walk of the slope over the usable image. 0.01 leaves a smooth curve,
which the cos⁴ vignettes of five recordings selected; mechanical ones selected 1."""

START_VIGNETTE_WALK = 0.1
"""That standard deviation until it is first selected, in the first round. Chosen by hand."""

VIGNETTE_REACH = 1.1
"""Radius of the last knot of ln V, in usable radii: the far corner if the centre is off by 0.1. Beyond, the slope is
constant. Chosen by hand."""

VIGNETTE_NUGGET = 1e-6
"""Independent variance of the slopes of ln V, which keeps their prior covariance invertible: a standard deviation of
0.001, far below that of any slope."""

ASYMMETRY_SIGMA = 0.0015
"""Apparent asymmetry caused by registration errors common to all samples, in ln V over a half diagonal; for the
centre, the shift that changes ln V by this much on average. It is added to the covariance before a free centre or
non-radial terms are accepted: without it, one of 50 centred recordings met the criterion. With 0.004, a weak vignette
decentred by 2 per cent was taken as centred, and its profile was wrong by six standard deviations."""

PROMISING_SHARE = 0.25
"""Further parameters are fitted only if one Newton step, which takes a third of the time, reaches this share of the
criterion. Near the criterion, the step reached 0.5 to 0.7 of the value of the full fit."""

FIRST_FIT_POINTS = 10_000
"""Number of scene points of the first, approximate fit, which only provides the start of the full fit and saves time.
20000 has no harmful effect; 5000 raises the errors by a quarter to two thirds."""

MIN_CRITERION_GROUPS = 3
"""Minimum number of pairs of frames assumed in the criterion: the logarithm of one or two is no penalty."""

MIN_USABLE_RADIUS = 0.01
"""Smallest usable radius of a vignette, in half diagonals: a few pixels, which contain no information about it."""

# The expected grey level (ospc.estimation.latent)

DARKEST_GREY = 0.25 / 255
"""Grey levels are raised to at least this value, a quarter of an 8-bit grey level, before taking the logarithm. No
effect from 0.1 to 0.5 of an 8-bit grey level."""

MAX_DEVIATION_SIGMAS = 6.0
"""Largest distance of a predicted grey level from the measured one, in standard deviations: outliers must not move
the point of linearisation to a very different part of the response. 3 has no effect on the response; 12 raises κ by a
quarter and the vignette error by half."""

CONVEX_ROUNDS = 2
"""Rounds in which every scene point counts, if there is no earlier fit. The first round is linearised at the measured
grey levels, whose noise makes gamma too small if most pairs have equal exposures; the remaining pairs, which
determine the response, would then look like outliers. After a second round they do not."""

LATENT_ITERATIONS = 3
"""Number of times that grey levels are predicted from their point's mean and linearised again. Chosen by hand; with
1, on 28 recordings, the vignette error is a fifth larger and the response's shape error a sixth smaller."""

MIN_ONE_MINUS_LEVERAGE = 1e-3
"""Lower limit of one minus the leverage, by which residuals are divided. No effect from 1e-4 to 1e-2."""

PIXEL_NOISE_STRIDE = 16
"""The noise of single pixels is tabulated at every 16th point of the response grid: at the 8-bit grey levels."""

# The shift of a mean of noisy pixels (ospc.estimation.mean_of_pixels)

SHIFT_LEVELS = 513
"""Grey levels at which the shift is computed, half an 8-bit grey level apart. No effect from 257 to 1025."""

SHIFT_QUANTILES = 65
"""Equally probable values that represent the normal distribution of noise; odd, so that zero is one of them."""

UNCLIPPED_SIGMAS = 4.0
"""Distance from black and white, in standard deviations of the noise, beyond which clipping has no influence. No
effect from 3 to 5."""

MIN_NOISE_LEVELS = 4
"""Minimum number of unclipped grey levels for fitting the read and shot noise."""

MIN_NOISE_IRRADIANCE = 1e-9
"""Lowest irradiance used in that fit, as a share of saturation: where gamma is almost a step, nearly all grey levels
below it correspond to no light. No effect from 1e-10 to 1e-7."""

NOISE_SHARE_SIGMA = 0.5
"""Standard deviation of the share of the noise that was added before the response and is bent by it. It is 1 without
further processing; strong sharpening, which amplifies noise after the response, leaves 0.23, and compression, which
removes noise, makes it 3. On simulated clean recordings, 0.3 and 0.5 change the median bound on κ by less than 1 per
cent, and that of the noisiest by a quarter; errors below a grey level of 40 are within two standard deviations at
99.6 and 99.8 instead of 99.5 per cent of the levels. Fitting it is no alternative: what noise shifts depends on the
grey level alone, as the response does, so that only the prior of the response would determine it. On twelve of 28
clean recordings, such estimates were wrong by more than two of their standard deviations."""

# The error model (ospc.estimation.error_model)

START_GREY_SIGMA = 0.5 / 255
START_REGISTRATION_SIGMA_PX = 0.5
START_RADIANCE_SIGMA = 0.005
"""Errors assumed before the first fit: half an 8-bit grey level, half a pixel, and half a per cent of the radiance.
The second round of a fit already replaces them."""

GREY_CELLS = 8
GRADIENT_CELLS = 4
"""Numbers of quantiles of grey level and of gradient. They form 32 cells over which squared residuals are summarised
to fit five coefficients. Chosen by hand; 6 to 12 cells of grey and 6 of gradient have no effect, 2 of gradient raise
the vignette error by half."""

MIN_PER_CELL = 40
"""Minimum number of observations for a cell's median squared residual, which then has a standard error of 37 per
cent. No effect from 20 to 80."""

MEDIAN_OF_SQUARED_NORMAL = 0.4549
"""Median of the square of a standard normal variable (chi-squared, one degree of freedom)."""

MIN_CELL_SIGMA = 0.02 / 255
"""Lower limit of a cell's standard deviation, in grey levels: keeps a cell of equal values from dominating the fit.
No effect from 0.01 to 0.05 of an 8-bit grey level."""

MIN_GREY_SIGMA = 0.05 / 255
"""Lower limit of the fitted constant error, in grey levels: no average over pixels is better than this. No effect
from 0.02 to 0.1 of an 8-bit grey level."""

MIN_RADIANCE_SIGMA = 1e-4
"""Lower limit of the fitted relative error of the radiance. No effect from 3e-5 to 1e-3."""

FACTOR_GREYS = (0.0, 0.03, 0.08, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.91, 0.95, 0.975, 1.0)
"""Grey levels at which the fitted variance is corrected by a factor: denser near the ends, where noise is clipped."""

FACTOR_RANGE = (0.25, 25.0)
"""Limits of these factors on the variance. Chosen by hand; 0.5 to 5 has no harmful effect, 0.1 to 100 raises the
vignette error by half."""

# The prior of the response (ospc.estimation.prior)

LEVEL_SIGMA = 0.6
"""Standard deviation of the logarithm of a camera's gamma about the typical one. Two thirds of the 201 measured
responses of Grossberg and Nayar (2003) lie within it."""

SLOPE_SIGMA = 1.0
"""Standard deviation of the slope of ln γ over all grey levels. 0.5 and 2 raise the shape error by a tenth."""

SHOULDER_SIGMA = 0.5
"""Standard deviation of the change of ln γ between :data:`SHOULDER_GREY` and white that does not continue the curve
below. In two thirds of the 201 measured responses, this change lies between none and a factor of 2.6."""

SHOULDER_GREY = 0.75
"""Grey level above which this change takes place, linearly. Chosen by hand; 0.85 has no effect, 0.65 lowered κ by a
fifth on these six recordings."""

TOE_SIGMA = 0.5
"""Standard deviation of the change of ln γ between :data:`TOE_GREY` and black that does not continue the curve above,
as that of the shoulder: sRGB and Rec. 709 are straight near black. Without it, smooth curves of eight recordings were
continued to black with errors of up to 5.4 standard deviations, 0.63 in ln g; with it, up to 4.5 and 0.06. 1 has no
further effect; κ and shape stay the same."""

TOE_GREY = 0.12
"""Grey level below which this change takes place, linearly. 0.2 left errors of 0.42 in ln g."""

WHITE_SIGMA = 0.3
"""Standard deviation of a further deviation of ln γ in the last few grey levels. 0.42, closer to the measured
responses, made the results of complete runs worse."""

BLACK_SIGMA = 0.2
"""Standard deviation of a further deviation of ln γ in the first few grey levels. Chosen by hand; 0.1 raises κ by a
quarter, 0.4 the shape error by a seventh."""

END_EXPONENT = 40
"""These two variances decrease with this power of the grey level (at black, of one minus the grey level): they halve
within 4.4 8-bit grey levels. Chosen by hand; 20 raises the shape error and 80 raises κ, both by a third."""

PRIOR_MIDDLE_GREY = 0.4
"""Grey level from which the random walks start towards both ends. No effect from 0.3 to 0.5."""

PRIOR_NUGGET = 1e-6
"""Added to the variance of ln γ at each knot so that its covariance is invertible. No effect from 1e-7 to 1e-5."""

WALK_CANDIDATES = (0.03, 10.0, 11)
DRIFT_CANDIDATES = (0.3, 1.0, 3.0, 10.0, 30.0)
"""Candidate hyperparameters, as standard deviations of ln γ over the whole range: of the random walk (smallest,
largest, number; geometric sequence) and of the random walk of the slope. They range from a straight line to a kink at
every knot."""

START_WALK = 1.0
START_DRIFT = 1.0
"""Hyperparameters until they are first selected, in the first round."""

# The fit (ospc.estimation.maximum_likelihood, fit)

MIN_GAMMA = 0.05
"""Lower limit of the coefficients of the local gamma, which keeps the response strictly increasing. Chosen by hand;
no effect from 0.02 to 0.1."""

MAX_GAMMA = 100.0
"""Upper limit of these coefficients, ten times those of any response that was fitted. In a video compressed to JPEG
quality 10, one grew without limit, until the equations overflowed."""

MAX_GAMMA_CHANGE = 3.0
"""Largest factor by which a coefficient may change in one round: the prior is linearised in its logarithm, and a
larger step would leave the range where that is valid. 5 has no effect, 2 raises the vignette error by 15 per cent."""

MAX_DECENTRING = 0.5
"""Largest distance between the vignette's centre and the image centre along each axis, in half diagonals. Real lenses
reach 0.1; with wrong exposures, the centre left the image and ln V overflowed."""

SETTLED_SIGMAS = 0.1
"""The rounds end when the parameters move less than this, as a root mean square in standard deviations. 0.03 has no
effect, 0.3 raises the shape error by a fifth."""

CHUNK_OBSERVATIONS = 4_000
"""Observations whose rows are built at once: about 1.2 MB, which limits the memory of a fit and fits into the
cache."""

WEIGHT_SCALE_SIGMAS = 3.0
"""Scale of the redescending weight 1/(1 + (r/scale)²)² (Geman and McClure 1987), in robust standard deviations: an
observation at two standard deviations keeps about half of its weight. Chosen by hand; 2 raises the vignette error by
four fifths, 4 the shape error by a fifth."""

WEIGHT_CUT_SIGMAS = 4.5
"""Residual, in robust standard deviations, beyond which an observation has no weight. Chosen by hand; 3.5 and 6 raise
the shape error by 84 and 49 per cent."""

MIN_SANDWICH_FACTOR = 0.2
"""Lower limit of the ratio of the mean derivative of the influence function to the mean weight. With many outliers
this ratio, and with it the information, would approach zero. Chosen by hand; no effect from 0.1 to 0.4."""

CLEAR_OF_ENDS_SIGMAS = 2.0
"""An observation is used only if its predicted grey level is this far from black and white, in standard deviations of
single pixels. Chosen by hand; 1 has no effect, 3 raises the shape error by a tenth."""

MAX_TEXTURE = 0.3
"""Largest relative standard deviation of the averaged pixels whose effect is corrected in full: except at knees, the
correction is of second order. 0.2 and 0.5 change κ by less than a tenth."""

TEXTURE_ERROR = 0.15
"""Relative standard deviation of the mean that this correction leaves, over the variance of the texture relative to
the squared grey level. Dark places between the lights of a city deviated by 0.12 to 0.17 of it, at relative standard
deviations of 0.15 to 0.4: the correction is of second order, and lights are clipped."""

TEXTURE_WIDTHS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Standard deviations of texture, relative to the grey level, for which the mean of pixels at a knee is tabulated.
The last exceeds :data:`MAX_TEXTURE`; below the first, the effect is 1/10 000 of the mean."""

TEXTURE_SPREADS = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28)
"""Relative standard deviations of the irradiance for which that mean is computed. Local gammas from 0.5 to 4 turn
them into the widths above."""

KNEE_LEVELS = 129
"""Number of grey levels at knees for which that mean is computed; it is interpolated linearly between them."""

MAX_NOISE = 0.2
"""Standard deviation of pixel noise, relative to the grey level, at which half of the effect of texture is corrected:
with more noise, too little of the variance is due to texture. 0.05 improves κ by only a third as much."""

TEXTURE_SHARE_INFORMATION = 2000.0
"""Precision of the prior that all variance except noise is texture (a share of one); an observation that texture
shifts by its standard deviation has a precision of one. In simulated recordings, where the share is one, the
observations alone gave -0.2 and 0.8 at precisions of 20 and 240, and 0.98 to 1.15 above 1400. With 300, dark and
noisy recordings gave 0 to 0.8, and κ was up to three times as large."""

MAX_RESPONSE_LEVELS = 4096
"""Most levels of a response table, one per 12-bit grey value: linear interpolation between them is accurate."""

MIN_RESPONSE_STEP = 1e-12
"""Smallest step of that table, as a share of g at white. A gamma as steep as 20 near black is zero in floating point
for several levels, but a response has to increase."""

SUPPORT_QUANTILES = (0.002, 0.998)
"""The response counts as measured between these quantiles of the observed grey levels, so that single outliers do not
extend the range."""

RATIO_DARKEST_GREY, RATIO_BRIGHTEST_GREY = 15 / 255, 245 / 255
RATIO_LOG_GREY_SPREAD = 0.3
"""Range of grey levels whose irradiance ratios are assessed, and standard deviation of the log ratio of two of them:
what a direct method compares. The ends of a response are hardly ever measured."""

RATIO_LEVELS, RATIO_PARTNERS, PROFILE_POINTS = 93, 4, 50
"""Number of grey levels at which the error of such ratios is predicted, three per interval between knots; number of
grey levels with which each is compared; and number of radii at which the error of the vignette is predicted."""

CONFIDENCE, ERROR_DRAWS = 0.95, 256
"""Probability that an error does not exceed the stated one, and number of parameter sets drawn from their covariance:
other draws change the stated error by a twentieth."""

UNRESOLVED_JUMP = 1 / 12
"""Standard deviation of ln g for a unit jump of γ within an interval of ln M of unit length, in which γ is fitted by
a straight line, and of ln V for a jump of its slope in R². The error is 1/8 for a jump in the middle, and less
elsewhere."""

MAX_REFERENCE_UNRESOLVED = 0.002
"""Largest such error of ln g at the grey level that the uncertainty of the response is relative to. It is 0.0003 at
most in the middle of smooth responses, and 0.01 to 0.03 at a kink, where it would be part of every difference."""

UNSEEN_CHANGE = 0.5
"""Standard deviation of the rate at which the slope of ln V changes beyond the last observations, relative to the
rate before them. Six sets of observations from simulated recordings were given fourteen vignettes and cut off at
radii of 0.96 (as recorded), 0.9 and 0.8. Without the vignettes whose mechanical part begins beyond, 70, 81 and 77 per
cent of the corners were within one standard deviation, and 96, 99 and 91 per cent within two. Without this
uncertainty, it was 57, 65 and 71, and 85, 86 and 91 per cent, and the worst error was nine standard deviations
instead of 2.6."""

UNSEEN_RESPONSE = 1.0
"""Standard deviation of ln g above the highest measured grey level, over the distance from it: some responses bend
sharply next to white. The 201 measured responses were fitted up to grey levels of 0.8 to 0.99 and extrapolated to
white: 81 to 87 per cent of the errors are within one standard deviation and 87 to 95 within two. Without it, it was
32 to 71 and 62 to 87."""

UNSEEN_OBSERVATIONS = 30
"""Radii that fewer observations exceed count as not seen. Chosen by hand."""

BEND_SMOOTHING = 0.06
"""Standard deviation, in grey levels, of the smoothing of γ before differentiation. Without it, the texture
correction follows the errors of the estimate, and κ of one recording in ten gets two to ten times worse."""

KNEE_SMOOTHING = 0.015
"""The same at knees, where the mean over a normal distribution is computed instead: half an interval between knots.
For five recordings of a camera with knees, the error of ln g(0.75)/g(0.25) is at most 0.006, but 0.008 at half and
0.012 at twice this width. Above :data:`SHOULDER_GREY`, it made the shape in a real video four times worse."""

KNEE_BEND = 3.0
"""Smallest part of g″/g′, per unit grey level, that the wider smoothing removes at a knee. It was at most 2.4 without
a knee, in 34 simulated recordings and a real video, and 14 to 29 with one."""

MAX_DARK_CLEARANCE = 0.1
"""Largest grey level excluded near black for that reason. Chosen by hand; no effect from 0.05 to 0.2."""

GROUPS_PER_BLOCK = 12
"""Maximum number of consecutive pairs of frames whose scores are added before their scatter is measured: neighbouring
pairs show the same scene and share its errors. Chosen by hand; no effect from 6 to 24 on recordings of this
length."""

MIN_BLOCKS = 16
"""Minimum number of such blocks, if there are as many pairs: the standard error of a variance from 16 blocks is
already 37 per cent. With fewer groups, confidence bands are at least as wide as for independent errors. 32 has no
effect, 8 raises the vignette error by half."""

DISAGREEMENT_SHARE = 1.0
"""Weight of the disagreement beyond chance between halves of the observations, relative to the scatter between groups
of pairs. With this value, 71 per cent of the vignette profile of 28 simulated recordings are within one standard
deviation of the truth; with 0.3 of all disagreement, including chance, it was 83, with bands a fifth too wide."""

# Effects other than response and vignette (ospc.estimation.effects)
#
# Each has three standard deviations: in cameras with the effect, in cameras where it goes unnoticed, and of spurious
# values in clean recordings. The second was chosen by hand. The third is about a quarter of the largest values in 47
# clean simulated recordings, so that none of these is significant.

BEYOND_WHITE = 0.6
"""Mean irradiance of white pixels in excess of that at white, relative to that at white: their grey level hides how
bright they are, but they cause glare, too. It was 0.3 to 0.9 in eight simulated recordings. With zero, glare of 2 per
cent was estimated as 2.5."""

LIGHT_FIT_FLOOR = 0.1
"""Irradiance, relative to that at white, above which the polynomial in the grey level fits g with equal relative
errors, and below which with equal absolute errors: few surroundings are darker. Without it, the error of dark
surroundings is three times as large for the simulator's filmic response."""

GLARE = (0.03, 0.03, 0.0005)
"""Veiling glare, as a share of the frame's mean irradiance. All lenses have some, mostly 1 to 5 per cent."""

SCATTER = (0.03, 0.03, 0.003)
"""Light scattered nearby, as a share of the irradiance of the surroundings. All lenses have some, and registration
errors at edges look similar."""

ADDED_LIGHT_MODEL_ERROR = 0.07
"""Standard deviation of the amount of added light that is corrected, as a share of it. In simulated recordings,
veiling glare of 0.01 to 0.05 was found to within 0.05 of its amount with three cameras, and 0.08 to 0.19 too low with
a fourth; 0.1 of light scattered nearby was found to within 0.05."""

STRAY_LIGHT = (0.03, 0.0, 0.0004)
"""Light that is fixed to the camera, at a typical exposure, as a share of the irradiance at white. Clean recordings
had at most 0.0004."""

OFFSET = (0.1, 0.001, 0.001)
"""Constant error of all exposures, as a share of a typical one: 25 µs at 5 ms is common, and 5 µs goes unnoticed.
With 0.1 for the second value, exposures with random errors of 1 per cent gave bands four times as wide as the errors.
With 0.005, 82 per cent of the response's shape were within one standard deviation in 28 clean recordings, with this
value 79."""

GAIN_STEP = (0.03, 0.0, 0.0006)
"""Step of ln of the gain at one exposure: a conversion gain or an entry of a gain table that is not exact. Clean
recordings had at most 0.0012, and 0.0003 on average."""

STEP_EXPOSURES, GAIN_STEP_MODEL_ERROR = 15, 0.1
"""Number of exposures at which a step of the gain is looked for; they divide the observations into sixteen equal
parts. And standard deviation of a step that is found, as a share of it, because it may lie between two of them."""

MOST_GAIN_STEPS = 2
"""Number of steps beyond which the errors of the exposures are left to the latent gains of frames. With 20 exposures,
each wrong by 2 per cent, up to nine steps were found, and kappa was 0.06 at a tenth of that stated."""

NOMINAL, LEAST_NOMINAL, MOST_NOMINAL = (1.0, 0.0, 0.01), 0.5, 1.5
"""Share of the distance of the exposures from the closest thirds of a stop by which they are wrong: 1 if they are
nominal shutter speeds. And its plausible range. 48 recordings with other exposures had at most 0.0013, or 0.011 with
errors of the exposures."""

DIFFERENT_LOG_EXPOSURE, MIN_STEP_EXPOSURES = 0.02, 3
"""Difference of ln of the exposure at which two exposures count as different, and number of different ones that is
needed on both sides of a step: with two exposures, any step is also a power of the exposures."""

LATENESS = (0.3, 0.03, 0.01)
"""Lag of all exposures in frames, after correction by whole frames: exposures that are time-stamped, interpolated or
averaged have one."""

LATENESS_MODEL_ERROR = 0.1
"""Share of a lag by which the real one may differ: interpolation between frames, which corrects it, also smooths the
exposures. With the mean of two frames' exposures, a lag of 0.48 frames and a spurious offset were found together, and
the exponent of the response was off by 0.074, 3.6 standard deviations; by 1.9 with this error."""

MOST_LATE_FRAMES = 1.0
"""Largest such lag: more is corrected by whole frames."""

LOCAL_TONE = (0.1, 0.0, 0.005)
"""Exponent by which bright surroundings brighten a point; negative if they darken it. Noticeable tone mapping has
-0.1 or stronger; equalisation within tiles of the image had 0.2. Clean recordings had 0.003 on average and at most
0.013."""

CURVATURE = (0.3, 0.0, 0.002)
"""Curvature of true ln exposure over the stated one: logarithms stored as exposures have about 0.4."""

RESPONSE_DRIFT = (0.1, 0.0, 0.003)
"""Half the change of ln γ from the first to the last group."""

BLACK_DRIFT = (0.1, 0.0, 0.0005)
"""Half the change of the black level, as a share of white."""

BLACK_BY_EXPOSURE = (0.1, 0.0, 0.0005)
"""Rise of the black level, as a share of white, when the exposure increases by a factor of e. In 97 simulated
recordings it was at most 3.2 standard deviations, and at least 5.6 if the gain raised the black level by 0.008 of
white."""

VIGNETTE_DRIFT = (0.1, 0.0, 0.002)
"""Half the change of ln V at the corner, or of its sideways slope per half diagonal. For the latter, clean recordings
had at most 1.7 standard deviations."""

MAX_ADDED_SHARE = 0.9
"""Largest share of added light at a point: keeps the logarithm finite on the way to the solution."""

MIN_EXPOSURE_FACTOR = 0.1
"""Smallest ratio of the true to the stated exposure, for the same reason."""

DARKEST_IRRADIANCE = 1e-3
"""Irradiances below this, relative to white, are raised to it when additional light is divided by them. Below the
black level of limited-range video g is almost zero, and single samples would dominate."""

# Selection of effects (ospc.estimation.model_choice)

SUSPECTED_SIGMAS = 1.5
"""Significance, in standard deviations, above which an effect is fitted jointly with all other parameters. A single
Newton step is a weak test, because the effect itself adds to the scatter by which it is judged."""

ABSORBED_FRAME_LIGHT, ABSORBED_NEARBY_LIGHT = 0.35, 0.5
"""Quantiles of the additional light that the response contains while effects are fitted: of the mean light of frames
and of the light of the surroundings. Smaller quantiles make fits converge more slowly: with the minimum, glare of
0.05 was estimated as 0.03."""

SUSPECTED_LIGHT_SIGMAS = 2.0
"""The same for added light, by chance alone. Near black, ln g is so nonlinear in added light that one step may go
only a tenth of the way."""

MIN_GROUPS = 30
"""Minimum number of pairs of frames for judging effects. None were found in 170 parts, of 45 to 90 pairs, of clean
simulated recordings, nor in 60 complete ones with 39 to 120 pairs."""

MOST_ADDED_LIGHT, MOST_OFFSET = 0.1, 0.3
"""Largest additional light and exposure offset of real lenses, sensors and shutters."""

SIGNIFICANT_SIGMAS = 5.0
"""Significance above which a fitted effect counts, in standard deviations by chance and by errors of clean
recordings."""

SIGNIFICANT_SIGMAS_IN_ALL = 3.0
"""The same, with the disagreement between halves of the observations included."""

CONTRADICTING_SIGMAS = 7.0
"""Significance, in standard deviations by chance and by the errors of clean recordings, above which a contradiction
counts even if the halves disagree: gentle tone mapping had 10, a digital zoom of 1.2 with a weak vignette 7.9, and
100 recordings without contradiction at most 5.2."""

EFFECT_PROBABILITY, CONTRADICTION_PROBABILITY = 0.3, 0.02
"""Prior probability that a camera has an effect that matters, and that a recording contradicts the model: few
recordings are tone mapped. They determine how much an effect that is left out widens the uncertainty: with 100 pairs,
an effect of 2.5 standard deviations counts half, and a contradiction of 3.5. With 0.5 instead of 0.3, a spurious
offset of 2.2 standard deviations made the response of a short recording marginal; with 0.1 instead of 0.02, spurious
tone mapping of 1.7 widened the band of a real video by half."""

PREFERRED_SHARE = 0.9
"""Significance, relative to the clearest effect, above which an effect of a camera is tried before a contradiction:
an offset of the exposures also resembles a curvature of their logarithm."""

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

# Constancy of response and vignette (ospc.estimation.residual_effects)

UNSTEADY_FEWEST_POINTS = 20
"""Minimum number of scene points of a pair for estimating its slope."""

UNSTEADY_SPREAD = 0.1
"""Smallest standard deviation of these points' ln M, or position in half diagonals: a slope needs a range."""

UNSTEADY_FEWEST_PAIRS = 30
"""Minimum number of such pairs: the scatter of 30 slopes is known to an eighth."""

UNSTEADY_SIGMAS = 3.5
"""Scatter of the slopes between pairs, relative to their standard errors, above which response or vignette are
unsteady. Registration and moving objects add to it: in 67 clean simulated recordings it was at most 3.0 over ln M and
2.4 over the position. It was 3.4 to 9 with two exponents a fifth apart, 3 to 16 with automatic contrast, and 2.2 to
8.6 with electronic stabilisation."""

UNSTEADY_SLOPE = 0.01
"""Smallest standard deviation of the slope between pairs that matters, in ln L per ln M or per half diagonal."""

GAIN_SIGMAS = 3.0
"""Number of standard deviations by which the scatter of the pairs' mean residuals must exceed chance before frames
get latent gains. Relative to independent errors of the points, it was at most 1 in 23 of 24 clean simulated
recordings, 2.5 in a real video, and 5 to 18 with clouds, flicker or drifting white balance."""

MOST_LOG_GAIN = 10.0
"""Largest latent gain, in ln, a factor of twenty thousand: a degenerate response would make it overflow."""

EXCEPTIONAL_SIGMAS = 2.5
"""Number of standard deviations from the prediction of all other pairs beyond which the gain of a pair is
exceptional, such as a frame with a wrong exposure or a light that is switched. Its variance is then increased until
it is exactly this far away. One in eighty normally distributed gains is exceptional."""

GAIN_MEMORIES = (3.0, 10.0, 30.0, 100.0)
"""Correlation times of the frames' gains, in frames. A mixture of these and of independent gains approximates
flicker, white balance and clouds; slower changes are hardly visible between the frames of a pair."""

PAIRS_PER_GAIN_BLOCK = 256
"""Maximum number of pairs whose gains are correlated. They span many times the longest memory, and matrices stay
small in runs of hours."""

EXCEPTIONAL_ITERATIONS, VARIANCE_ITERATIONS = 3, 3
"""Iterations for the weights of exceptional pairs, and for the variances of gains, per round of a fit."""

MOST_RADIANCE_SIGMA = 0.04
"""Relative standard deviation of a point's radiance between frames, beyond noise, above which one response and one
vignette do not explain the images. It was at most 0.01 in 39 clean simulated recordings, 0.005 in a real video, with
crowds and with glossy surfaces, and 0.07 to 0.09 if contrast was equalised in tiles."""

# Uncertainty of exposure ratios (ospc.methods.summary)

MISREGISTERED_SPREAD = 3.0
"""Scatter of a pair's points, relative to typical pairs, above which the frames count as misregistered: two thirds of
such pairs are wrong by more than a tenth. No effect from 2 to 6."""

MISREGISTERED_SIGMAS = 2.0
"""Standard deviation of such a pair's exposure ratio, as a multiple of that scatter: the points share one error, so
their number does not reduce it."""
