"""Constants of the expected grey levels and their errors: their meaning, unit and the reason for their value.

"Chosen by hand" and "no effect" are explained in :mod:`ospc.settings.fit`.
"""

# The expected grey level (ospc.estimation.latent)

DARKEST_GREY = 0.25 / 255
"""Grey levels are raised to at least this value, a quarter of an 8-bit grey level, before taking the logarithm; no
point is excluded. No effect from 0.1 to 0.5 of an 8-bit grey level."""
MAX_DEVIATION_SIGMAS = 6.0
"""Largest distance of a predicted grey level from the measured one, in standard deviations: outliers must not move
the point of linearisation to a very different part of the response. 3 has no effect on the response; 12 raises κ by a
quarter and the vignette error by half."""
CONVEX_ROUNDS = 4
"""Rounds in which every scene point counts, if there is no earlier fit. Points that the response does not yet
describe look like outliers, and those at a knee may then stay without weight: with two rounds, ln g across a knee was
off by 0.02 to 0.03, five standard deviations, in a video with automatic exposure. It was off by 0.003 with three, and
by 0.002 with four and six."""
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
NOISE_SHARE_SIGMA = 1.0
"""Standard deviation of the share of the noise that was added before the response and is bent by it. It is 1 without
further processing. Strong sharpening, which amplifies noise after the response, leaves 0.23. In the grey of a colour
camera, each channel bends its own noise before they are added, which reduces it: the share is 2.2 for luma and 3 for
the mean of three channels; compression, which removes noise, makes it 3. With 0.5, ln g between grey 20 and 30 was
off by 3.7 to 5.1 standard deviations in seven recordings of such greys. Fitting it is no alternative: what noise
shifts depends on the grey level alone, as the response does, so that only the prior of the response would determine
it. On twelve of 28 clean recordings, such estimates were wrong by more than two of their standard deviations."""

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
