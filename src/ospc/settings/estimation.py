"""Constants of the default method's fit: what each is, its unit, and why it has this value."""

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

# The vignette basis (ospc.estimation.vignette_basis, vignette_choice)

VIGNETTE_SIGMA = 2.0
"""Prior standard deviation of the vignette's parameters, in ln V at the corner; that of the i-th radial term is
divided by i. Wide beside real lenses: cos⁴ at a half angle of 45° has a first coefficient of -2."""

ASYMMETRY_SIGMA = 0.004
"""Asymmetry that registration errors common to all samples imitate, in ln V over a half diagonal. Added to the
covariance before a free centre or non-radial terms are accepted."""

FIRST_FIT_POINTS = 10_000
"""Scene points from which the first, approximate fit is made, to save time: it only starts the fit to all of them."""

# The expected grey level (ospc.estimation.latent)

DARKEST_GREY = 0.25 / 255
"""Lowest grey level whose logarithm is used; darker ones are taken for this. A quarter of an 8-bit grey level."""

MAX_DEVIATION_SIGMAS = 6.0
"""How far a predicted grey level may be from the measured one, in standard deviations: outliers must not move the
point of linearisation to where the response is quite another."""

LATENT_ITERATIONS = 3
"""Rounds of predicting the grey levels from their point's mean and linearising anew."""

MIN_ONE_MINUS_LEVERAGE = 1e-3
"""Least value of one minus the leverage, by which residuals are divided."""

PIXEL_NOISE_STRIDE = 16
"""The noise of single pixels is tabulated at every 16th point of the response's grid: at the 8-bit grey levels."""

# The shift of a mean of noisy pixels (ospc.estimation.noisy_mean)

SHIFT_LEVELS = 513
"""Grey levels at which the shift is computed, half an 8-bit grey level apart."""

SHIFT_QUANTILES = 65
"""Equally probable values that stand for the normal distribution of noise; odd, so that zero is one of them."""

UNCLIPPED_SIGMAS = 4.0
"""Distance from black and white, in standard deviations of the noise, from which on clipping does not change it."""

MIN_NOISE_LEVELS = 4
"""Fewest unclipped grey levels from which read and shot noise, two unknowns, are fitted."""

MIN_NOISE_IRRADIANCE = 1e-9
"""Least irradiance, as a share of saturation, used in that fit: where gamma is as steep as a step, next to none of
the grey levels below it mean any light."""

# The error model (ospc.estimation.error_model)

START_GREY_SIGMA = 0.5 / 255
START_REGISTRATION_SIGMA_PX = 0.5
START_RADIANCE_SIGMA = 0.005
"""Errors assumed before any are fitted: half an 8-bit grey level, half a pixel, half a per cent of the radiance. The
second round of a fit already replaces them."""

GREY_CELLS = 8
GRADIENT_CELLS = 4
"""Quantiles of grey level and of gradient that make up the 32 cells over which squared residuals are summarised: five
coefficients are fitted to them."""

MIN_PER_CELL = 40
"""Fewest observations whose median squared residual is used: its standard error is then 37 per cent."""

MEDIAN_OF_SQUARED_NORMAL = 0.4549
"""Median of the square of a standard normal variable (chi-squared, one degree of freedom)."""

MIN_CELL_SIGMA = 0.02 / 255
"""Least standard deviation of a cell, in grey levels: keeps a cell of equal values from ruling the fit."""

MIN_GREY_SIGMA = 0.05 / 255
"""Least constant error of the fitted model, in grey levels: no averaging over pixels is better than that."""

MIN_RADIANCE_SIGMA = 1e-4
"""Least relative error of the radiance of the fitted model."""

FACTOR_GREYS = (0.0, 0.03, 0.08, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.91, 0.95, 0.975, 1.0)
"""Grey levels at which the fitted law is corrected by a factor: denser near the ends, where noise is clipped."""

FACTOR_RANGE = (0.25, 25.0)
"""Least and largest of these factors of the variance."""

# The prior of the response (ospc.estimation.prior)

LEVEL_SIGMA = 0.6
"""Standard deviation of the logarithm of a camera's gamma about the typical one; two in three of the 201 measured
responses of Grossberg and Nayar (2003) lie within it."""

SLOPE_SIGMA = 1.0
"""Standard deviation of the slope of ln γ over the whole range of grey levels."""

SHOULDER_SIGMA = 0.5
"""Standard deviation of the change of ln γ between :data:`SHOULDER_GREY` and white, beyond what the curve does below;
two in three of the 201 measured responses lie between no change and a change by a factor of 2.6."""

SHOULDER_GREY = 0.75
"""Grey level above which that change takes place, linearly."""

WHITE_SIGMA = 0.3
"""Standard deviation of what ln γ does besides in the last few grey levels. 0.42, nearer to the measured responses,
made the results of whole runs worse."""

BLACK_SIGMA = 0.2
"""Standard deviation of what ln γ does besides in the first few grey levels."""

END_EXPONENT = 40
"""Power of the grey level (at black: of one minus it) with which these two variances fall off: they halve within 4.4
8-bit grey levels."""

PRIOR_MIDDLE_GREY = 0.4
"""Grey level from which the random walks start, towards both ends."""

PRIOR_NUGGET = 1e-6
"""Added to the variance of ln γ at each knot, so that its covariance can be inverted."""

WALK_CANDIDATES = (0.03, 10.0, 11)
DRIFT_CANDIDATES = (0.3, 1.0, 3.0, 10.0, 30.0)
"""The hyperparameters to choose from, as standard deviations of ln γ over the whole range: of the random walk (least,
largest, number; equal ratios) and of the walk of the slope. They span a straight line to a kink at every knot."""

START_WALK = 1.0
START_DRIFT = 1.0
"""Hyperparameters before the first choice; that choice follows in the first round."""

# The fit (ospc.estimation.maximum_likelihood, fit)

MIN_GAMMA = 0.05
"""Least coefficient of the local gamma: keeps the response strictly increasing."""

MAX_GAMMA_CHANGE = 3.0
"""Largest factor by which a coefficient changes in one round: the prior is linearised in its logarithm, which a
larger step leaves behind."""

SETTLED_SIGMAS = 0.1
"""The rounds end when the parameters move less than this, as a root mean square in standard deviations."""

CHUNK_OBSERVATIONS = 20_000
"""Observations whose rows are built at once: about 6 MB, which bounds the memory of a fit."""

WEIGHT_SCALE_SIGMAS = 3.0
"""Scale of the redescending weight 1/(1 + (r/scale)²)² (Geman and McClure 1987), in robust standard deviations: an
observation at two standard deviations keeps about half of its weight."""

WEIGHT_CUT_SIGMAS = 4.5
"""Residual, in robust standard deviations, from which on an observation has no weight."""

MIN_SANDWICH_FACTOR = 0.2
"""Least ratio of the mean derivative of the influence function to the mean weight: with many outliers it approaches
zero, and with it the information would."""

CLEAR_OF_ENDS_SIGMAS = 2.0
"""Distance of the predicted grey level from black and white, in standard deviations of single pixels, below which an
observation is not used."""

MAX_DARK_CLEARANCE = 0.1
"""Largest grey level that is left out at the dark end for that reason."""

GROUPS_PER_BLOCK = 12
"""Most consecutive pairs of frames whose scores are added before their scatter is measured: neighbouring pairs show
the same scene and share its errors."""

MIN_BLOCKS = 16
"""Fewest such blocks, if there are as many pairs: the standard error of a variance from 16 is already 37 per cent."""

SYSTEMATIC_VIGNETTE_SHARE = 0.008
"""Share of ln V that is wrong however many samples there are, since registration is drawn to where brightness agrees;
measured on simulated recordings."""
