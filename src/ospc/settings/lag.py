"""Constants of the search for the lag of the exposures: their meaning, unit and the reason for their value."""

import numpy as np

from ospc.settings.exposures import CONSTANT_EXPOSURE_LOG

# The likelihood of a lag (ospc.exposures.lag_likelihood)

STUDENT_T_DOF = 4.0
"""Degrees of freedom of Student's t distribution of the noise: its tails are heavy, but its variance is finite."""
MAX_REWEIGHTINGS = 10
"""Maximum number of reweighting rounds of each kind; by then the weights hardly change."""
MIN_NOISE_SCALE_LOG = 1e-4
"""Minimum scale of the noise, in ln of the grey level, so that rounding errors of noise-free images do not decide."""
SLOPE_POOLING = 0.05
"""Weight of the common slope in each bin, relative to the mean weight of the bins: bins with few observations follow
the others, and those with many are hardly affected."""
SLOPE_RIDGE, TERM_RIDGE = 1e-9, 1e-6
"""Ridges on the slopes and on the amplitudes of the vignette's terms, so that the equations have a solution without
changes of exposure or motion. Both are far below what one pair of frames with such changes adds."""
RELATIVE_SLOPE_ERROR = 0.1
"""Relative error of the slopes allowed for when outliers are weighted down: otherwise slightly wrong slopes would
turn the largest changes of exposure, the most informative ones, into outliers."""
SLOPE_FACTOR_LIMITS = (0.8, 1.25)
"""Limits of the factor on the slopes that is fitted with the noise model: the bins determine the slopes to within a
quarter, and smooth noise could otherwise explain smooth exposures on its own."""
INEXACT_SLOPE_FACTOR_LIMITS = (0.8, 8.0)
"""The same if individual exposures are inexact: their errors make the slopes of the bins too small."""
INEXACT_OUTLIER_FACTOR = 4.0
"""If individual exposures are inexact, residuals up to this multiple of their mean are not outliers: most changes
may be pure errors, and the few real ones must not look like the outliers."""
REWEIGHTING_TOLERANCE = 1e-6
"""Change of the slopes, and relative change of the scale, below which they have converged: near its maximum the
likelihood changes far less."""
MAX_AR_SUM = 0.98
"""Largest sum of the magnitudes of the autoregressive coefficients: below one, so that the noise is stationary."""
AR_RIDGE = 1e-3
"""Ridge on these, relative to the mean diagonal of the normal matrix: noise-free recordings do not determine them."""
REGRESSION_RIDGE = 1e-9
"""The same on the factor of the exposures and the amplitudes of other causes: against rounding alone."""
MIN_FITTED_LOG_CHANGE = 1e-9
"""Change of ln exposure below which it is mere rounding, and no slope is fitted."""

# Acceptance of a lag (ospc.exposures.lag_selection)

MOST_LAG_FRAMES = 1000
"""Largest lag that can be stated; no camera buffers this many frames."""
MAX_COMMON_LAG = 3
"""Largest common lag, in frames; larger ones are accepted only if nothing else fits."""
MIN_LAG_LEAD = 10.0
"""Log likelihood by which the best lag must lead. Taken literally, this is 22000 to 1, but the noise does not quite
follow the model, and a wrong lag ruins a calibration while an undetermined one only leaves it marginal."""
MIN_LAG_SIGMAS = 2.0
"""Minimum lead of the best lag relative to its standard error, from the scatter between pairs (Vuong 1989): a few
pairs with large leads are not enough."""
FLICKER_LEAD_FACTOR = 1.5
"""Factor on both limits of the lead if flicker is fitted too: it removes most of the evidence from exposures of the
same period."""
UNCOMMON_LAG_FACTOR = 1.75
"""An unusual lag must beat a usual one by this factor in standard deviations, and by its square in log likelihood."""
MIN_DISTINCT_PAIRS = 5
DISTINCT_NOISE_SCALES = 0.5
"""Minimum number of pairs for which two lags must predict different brightness changes, and the minimum difference in
units of the noise scale: a single change of exposure, or a single wrong one, is not enough."""
MIN_EXPLAINED_SHARE = 0.05
"""Share of the energy of brightness changes that exposures must explain to count as visible in the images."""
FLAT_RESPONSE_SLOPE = 0.2
"""d ln M/d ln e of a flat response. If changes of brightness by this times the changes of exposure would be lost in
the noise, exposures that are not visible have changed too little; otherwise the images do not respond to them."""
CORRELATED_PAIRS = 4
"""Number of pairs over which leads are treated as correlated: they share frames and objects."""
MIN_CORRELATED_VARIANCE_RATIO = 0.5
"""Lower limit of the variance of a mean, relative to that for independent pairs: correlations are estimated from few
pairs and must not make the mean look more certain than this."""
FRACTIONAL_LAGS = np.array([-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6])
"""Offsets from a lag at which the fit is tried, in frames: beyond half a frame, so that the maximum is visible."""
MAX_FRACTIONAL_LAG = 0.45
"""Largest offset of the best fit from the lag, in frames: near half a frame, neither of the two lags is right."""
MIN_FRACTIONAL_LAG_LEAD = MIN_LAG_LEAD / 2
"""Log likelihood by which an offset between frames must lead: half that of a lag, because it only raises a doubt."""
FLICKERING_EXPOSURE_SHARE = 0.87
"""Minimum share of the energy of fast exposure changes at the period of the flicker if they follow it. Noise of
auto exposure keeps it below one; changes that share the period by chance have less."""
MAX_FOLLOWING_CHANGE_LOG = 0.4
"""Largest standard deviation of fast changes of ln exposure that follow a flicker: auto exposure follows only part of
a lamp's flicker, which seldom exceeds 0.2. The brackets of five clean recordings had 0.8 to 1.6. What the linear
model of brightness left unexplained at their period was taken for flicker. If larger changes from frame to frame do
not show in the images, the exposures are wrong, whatever changes over several frames show."""

# The search for the lag (ospc.exposures.lag)

MAX_LAG = 5
"""Largest lag tried in either direction, in frames: one to three are common, and each more adds a fit and a rival."""
MIN_LAG_PAIRS = 20
"""Minimum number of pairs for fitting lags: a fit has about twelve unknowns, and any lag fits fewer pairs."""
MIN_PAIR_LOG_CHANGE = CONSTANT_EXPOSURE_LOG / 10
"""Change of ln exposure that some compared pair must exceed; otherwise the exposure was constant in these frames."""
MAX_FLICKERS = 2
"""Most periodic changes fitted with the exposures: a lamp's frequency and its harmonic. More would fit anything."""
MAX_FLICKER_CANDIDATES = 3
"""Maximum number of frequencies tried for each of them; every one costs a fit of all lags."""
SAME_FREQUENCY = 0.01
"""Difference, in cycles per frame, up to which two frequencies are the same: the resolution of a hundred frames."""
MIN_FLICKER_LEAD = 15.0
"""Gain in log likelihood required of a periodic change. The best of 500 frequencies gains about ln 500 = 6 by chance,
more if the noise does not quite follow the model."""
LONG_INTERVALS_FRAMES = (4, 8)
"""Numbers of frames over which changes are compared if frame-to-frame changes are inconclusive: the error of a single
exposure counts that much less against a steady change. Over more frames the scene is lost."""
AGREEING_LAG_SIGMAS = 2.4
OPPOSING_LAG_SIGMAS = 4.0
"""Standard deviations by which changes over long intervals must prefer a lag, if frame-to-frame changes also prefer
it and if they do not. These exceed :data:`MIN_LAG_SIGMAS` because long intervals overlap and slow errors weigh
more."""
MAX_LONG_INTERVAL_DEFICIT = 3.0
"""Log likelihood by which the lag from long intervals may trail the best frame-to-frame one: twenty times less
likely."""
DOUBTFUL_RESPONSE_SLOPE = 0.25
"""Median d ln M/d ln e below which an accepted lag is tried again with inexact exposures. A gamma of 2.2 has 0.45;
errors of the exposures, like a wrong lag, make it look smaller."""
EXPOSURE_ERROR_SCALES = (2.0, 8.0)
"""Errors of individual exposures that are tried, relative to the other noise: two clearly different sizes, so that a
result that depends on the size is rejected."""
SWINGING_EXPOSURE_SHARE = 0.5
"""Share of the energy of the exposure changes above which one period dominates them."""
MAX_SWINGING_EXPOSURE_LOG = 0.1
"""Standard deviation of ln exposure up to which exposures may follow a swinging light: they swing no more than it
does. Chosen by hand: a higher limit would doubt programmed exposures, which vary more."""

# Changes of the lag (ospc.exposures.lag_change)

LAG_CHANGE_WINDOW_FRAMES = 400
"""Number of latest frames searched for a change: twenty seconds at 20 frames/s, which contain a few bursts of
compared frames even late in a run."""
MIN_PAIRS_BEFORE_LAG_CHANGE = 100
"""Minimum number of pairs of frames before a change: fewer may all show one passing cloud that auto exposure
follows, so that the earlier lag was less certain than it seemed. Fewer suffice if they exclude the later lag as
surely as the others exclude the earlier one, by :data:`EARLIER_LAG_LEAD`."""
LAG_CHANGE_START_TOLERANCE = 1.0
"""Log likelihood that may be sacrificed for a later start of the change, so that uninformative pairs do not count as
changed."""
SUSPECTED_LAG_CHANGE_LEAD = 4.0
"""Log likelihood by which another lag must lead before more frames are compared. One in ten checks of unchanged video
reaches this; without the additional frames it took up to half a minute to prove a change."""
LATER_LAG_LEAD, EARLIER_LAG_LEAD = 25.0, 50.0
"""Log likelihood that proves that exposures are later or earlier than before. Light followed by smooth auto
exposure looks like earlier ones. In ten hours of unchanged video, the largest false leads were 21 and 32."""
MIN_LIGHT_PERIOD_FRAMES = 48
"""Shortest period of light changes that are distinguished from exposures: a second at 50 frames/s. While light
drifts, an exposure that changes its rate seems late or early; without this allowance, false leads reach 60."""
