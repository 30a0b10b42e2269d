"""Constants of the fit and of its stated uncertainty: their meaning, unit and the reason for their value.

"Chosen by hand" means that a value rests on judgement alone. Where the constants of the estimation mention another
value, the fit was repeated with it on six simulated recordings (200 frames of 480×360 pixels; six responses, three
vignettes, both noise levels, one with moving objects and one with flicker). "No effect" means that the median
response shape error, κ and vignette error changed by less than 3 per cent; otherwise the change is given. "Raises the
vignette error by half" and "raises κ by a quarter" are mostly due to one recording for which a different vignette
model is selected.
"""

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
observation at two standard deviations keeps about half of its weight. Chosen by hand: over 58 simulated recordings, 4
raises the vignette error by a tenth; 2 lowers it by a twentieth, but the bands hold less of the truth in 160 other
recordings."""
WEIGHT_CUT_SIGMAS = 4.5
"""Residual, in robust standard deviations, beyond which an observation has no weight. Chosen by hand; 4 and 6 change
the errors by up to 2 per cent."""
MIN_SANDWICH_FACTOR = 0.2
"""Lower limit of the ratio of the mean derivative of the influence function to the mean weight. With many outliers
this ratio, and with it the information, would approach zero. Chosen by hand; no effect from 0.1 to 0.4."""
CLEAR_OF_ENDS_SIGMAS = 2.0
"""An observation is used only if its predicted grey level is this far from black and white, in standard deviations of
single pixels. Chosen by hand; 1 has no effect, 3 raises the shape error by a tenth."""
MAX_TEXTURE = 1.0
"""Largest relative standard deviation of the averaged pixels whose effect is corrected in full. With 0.3, the
vignette was off by 0.011 for a response with a local gamma of 0.5, where half of the points exceed 0.58, and by
0.003 with 1."""
TEXTURE_ERROR = 0.15
"""Relative standard deviation of the mean that this correction leaves, over the variance of the texture relative to
the squared grey level. Dark places between the clipped lights of a city deviated by 0.12 to 0.17 of it, at relative
standard deviations of 0.15 to 0.4. With 0.05, errors of 51 recordings stayed the same, and bands of the
response were 7 % more often exceeded."""
MAX_SHIFT = 0.3
"""Largest shift of the mean by texture, relative to the grey level, from which its computation starts. 0.15 and 0.6
give the same vignettes."""
MAX_SKEWNESS = 5.0
"""Largest skewness that counts; a tenth of the points of a coarse texture had more than 4. 2 and 10 change vignettes
by less than their errors."""
TEXTURE_WIDTHS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Standard deviations of texture, relative to the grey level, for which the mean of pixels at a knee is tabulated.
Beyond the last, the decrease per variance stays constant; below the first, the effect is 1/10 000 of the mean."""
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
"""Number of grey levels at which the error of such ratios is predicted, two per interval between knots; number of
grey levels with which each is compared; and number of radii at which the error of the vignette is predicted."""
CONFIDENCE, ERROR_DRAWS = 0.95, 256
"""Probability that an error does not exceed the stated one, and number of parameter sets drawn from their covariance:
other draws change the stated error by a twentieth."""
UNRESOLVED_JUMP = 1 / 12
"""Standard deviation of ln g for a unit jump of γ within an interval of ln M of unit length, in which γ is fitted by
a straight line, and of ln V for a jump of its slope in R². The error is 1/8 for a jump in the middle, and less
elsewhere."""
RESOLVED_INTERVALS = 32
"""Most equal intervals of grey level that are resolved, however many knots there are: the pixels that are averaged
differ in grey level, which blurs a jump. At a knee, ln g was off by 0.03 to 0.04 with 32 intervals between knots and
with 48."""
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
MAX_UNSEEN_FALL = 0.9
"""Largest share by which V is assumed to fall from the last observations to a knot beyond, at its present slope in
R². If V falls by more than a third, the rate is more uncertain than by :data:`UNSEEN_CHANGE`. Vignettes with V of
0.1, 0.15 and 0.25 at the corners were observed up to 0.97, 0.93 and 0.88 of each side. The root mean square error at
the corner was 4.0, 2.5 and 1.3 standard deviations without this, and is 1.7, 1.6 and 1.1 with it. Where V is at least
0.35 at the corner, it has hardly any effect."""
UNSEEN_RESPONSE_CHANGE = 0.5
"""Standard deviation of the slope of ln g above the highest measured grey level, relative to the slope there: some
responses bend sharply next to white. The 201 measured responses were extrapolated from nine grey levels of 0.4 to
0.99: 67 to 86 per cent of the errors at white are within one standard deviation, 91 to 92 within two, and the largest
is 7. With a standard deviation of 1 for all slopes, it was 59 to 77, 81 to 94, and 28."""
UNSEEN_OBSERVATIONS = 30
"""Radii that fewer observations exceed count as not seen. Chosen by hand."""
BEND_SMOOTHING = 0.06
"""Standard deviation, in grey levels, of the smoothing of γ before differentiation. Without it, the texture
correction follows the errors of the estimate, and κ of one recording in ten gets two to ten times worse."""
KNEE_SMOOTHING = 0.0104
"""The same at knees, where the mean over a normal distribution is computed instead: half an interval between knots.
Within knees, ln g of 47 simulated recordings is off by 14 % more with 0.015, and by 10 % less with 0.0075, but κ is
the same. Above :data:`~ospc.settings.response.SHOULDER_GREY`, it made the shape in a real video four times worse."""
KNEE_BEND = 3.0
"""Smallest part of g″/g′, per unit grey level, that the wider smoothing removes at a knee. It was at most 2.4 without
a knee, in 34 simulated recordings and a real video, and 14 to 29 with one."""
MAX_DARK_CLEARANCE = 0.1
"""Largest grey level that :data:`CLEAR_OF_ENDS_SIGMAS` excludes near black. Chosen by hand; no effect from 0.05 to
0.2."""
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
MIN_DETERMINED_PARAMETERS = 1e-9
"""Smallest number of parameters that the observations determine, which divides the scatter of their scores: less is
rounding."""
MIN_SCORE_SPREAD = 1e-6
"""Lower limit of this scatter relative to that of independent errors: observations without any noise would otherwise
have infinite information."""
SHARED_ERROR = 0.001
"""Standard deviation of the error that the points of a pair share with those of other pairs of about the same
exposure ratio and grey levels, in ln of the irradiance ratio, per ln of the exposure ratio: what corrections of noise
and texture and the registration leave. In simulated brackets with measured responses it is 0.0005 to 0.003 for ratios
of 4 and 16. It matters in brackets: of 13 with a ratio of 4, 56 and 79 % of ln g were within one and two standard
deviations without it, and 71 and 90 % with it; with automatic exposure, 71 and 95 % became 73 and 95 %. Of 14 others
that were not used to choose it, 66 and 91 % became 85 and 96 %."""
LOG_RATIO_DECIMALS = 9
"""Decimals to which ln of exposure ratios is rounded before they are compared: those of a bracket are equal, and the
unit of the exposures must not decide which half of the pairs one belongs to."""
SHARED_ERROR_LOG_RATIO, SHARED_ERROR_GREY = 0.35, 0.0625
"""Differences of ln of the exposure ratio, half a stop, and of the grey level, three intervals between the knots of
the response, over which this error is taken to be the same."""
