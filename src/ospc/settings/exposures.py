"""Constants of the assessment of exposures: their meaning, unit and the reason for their value."""

from __future__ import annotations

import numpy as np

# Changes of brightness between two frames (ospc.exposures.brightness)

GREY_BIN_EDGES = np.array([0.05, 0.09, 0.14, 0.20, 0.27, 0.35, 0.44, 0.54, 0.65, 0.78, 0.93])
"""Edges of the grey bins: the same change of exposure changes ln M differently at different grey levels. Bins are
narrower where responses are steeper; black and white, where noise is clipped, are excluded."""
GREY_BIN_EDGES.setflags(write=False)

MIN_BIN_PIXELS = 40
"""Minimum number of points for a bin's mean or for the median motion: the standard error is a sixth of the scatter.
With fewer, one moving object would dominate; with more, small images would leave bins empty."""

MAX_BIN_WEIGHT = 5000.0
"""Most points that a bin counts as; otherwise one large uniform surface, whose errors share a cause, would
dominate."""

MAX_RELATIVE_GRADIENT = 0.04
"""Largest relative gradient (gradient over grey level, per thumbnail pixel) of a flat point. A registration error of
a tenth of a pixel then changes ln M by at most 0.004; a lower limit would leave too few points in textured scenes."""

BIN_OUTLIER_SIGMAS = 2.5
"""Points further from their bin's median than this, in robust standard deviations, are excluded from its mean: moving
objects, gloss, wrong registrations. This keeps 99 per cent of normally distributed values."""

MIN_BIN_SCATTER_LOG = 1e-4
"""Minimum scatter assumed in a bin, in ln of the grey level: keeps rounding errors of nearly equal values."""

PIXEL_SAMPLES_PER_PAIR = 400
"""Approximate number of single points kept per pair: about thirty in each cell of the local tone mapping check."""

MOTION_STRIDE = 5
"""The motion is measured at one in this many points: neighbours move alike, so more cost time and add nothing."""

MIN_MOTION_GRADIENT = 0.01
"""Minimum gradient, in full scale per thumbnail pixel, of a point whose displacement is measured: at flatter points,
registration interpolates from the surroundings."""

DARKEST_LEVEL = 1e-3
"""Grey levels are raised to at least this value, a quarter of an 8-bit grey level, before taking the logarithm."""

# Selection of brightness changes (ospc.exposures.brightness_series)

AR_ORDER = 2
"""Order of the autoregressive noise: neighbouring pairs share a frame, and registration errors swing back."""

MIN_PAIR_WEIGHT = 100.0
"""Minimum number of points for a pair of frames to be used: fewer often share one error, on a moving object."""

MAX_BIN_DEVIATION_LOG = 0.02
MAX_BIN_DEVIATION_SHARE = 3.0
"""A bin is used if it differs from the middle bin by no more than the sum of both, in ln of the grey level: a
constant for registration errors, and a multiple of the middle change because the slope of a response varies this much
between bins."""

# Number of brightness changes kept (ospc.exposures.brightness_history)

MAX_BRIGHTNESS_CHANGES = 1200
"""Maximum number of brightness changes kept: computing the likelihood of a lag then takes a tenth of a second."""

MAX_CHANGES_WITH_SAMPLES = 160
"""Maximum number of brightness changes whose single points, which take most memory, are kept: enough to detect local
tone mapping."""

MAX_REPEATED_FRAMES = 1000
"""Maximum number of repeated frames whose numbers are kept: enough to inspect, however long the run."""

# When the exposures are assessed (ospc.exposures.monitor)

FIRST_ASSESSMENT_CHANGES = 39
"""Number of brightness changes before the exposures are first assessed: fewer rarely determine a lag."""

ASSESSMENT_GROWTH = 1.5
"""Exposures are assessed again whenever the number of brightness changes has grown by this factor."""

LAG_SEARCH_CHANGES = 400
"""Brightness changes after which a lag that is still unknown is searched for only in the regular runs of frames."""

LAG_CHECK_INTERVAL_CHANGES, SUSPECTED_LAG_CHECK_INTERVAL_CHANGES = 16, 8
"""Number of brightness changes between two checks for a change of the lag, normally and while one is suspected. Late
in a run, these are five seconds of film, which costs a hundredth of the run's time, and half a second."""

EXPOSURE_CHANGE_FRAMES = 8
"""Frames around a frame within which the exposure must change to be informative about the lag: the largest lag and
some."""

MIN_EXPOSURE_CHANGE_LOG = 0.02
"""Change of ln exposure over these frames that is visible in the images."""

# Exposures over time (ospc.exposures.table)

CONSTANT_EXPOSURE_LOG = 0.005
"""Range of ln exposure below which it counts as constant: half a per cent is lost in the noise of registration."""

CHANGED_EXPOSURE_LOG = 0.01
"""Change of ln exposure above which a frame counts as exposed differently from the previous one: 1 per cent."""

MAX_CYCLE_FRAMES = 60
"""Longest cycle of exposures considered, in frames: brackets have fewer than ten, programmed sweeps several tens."""

MIN_CYCLES = 3
"""Minimum number of repetitions of a cycle within the recording: two may be equal by chance."""

SAME_EXPOSURE_LOG = 1e-3
"""Difference of ln exposure up to which two exposures count as equal: rounding in files and jitter of sensors."""

MIN_CYCLE_SHARE = 0.97
"""Minimum share of the frames that repeat a cycle, so that a few dropped frames do not break it."""

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

RELATIVE_SLOPE_ERROR = 0.1
"""Relative error of the slopes allowed for when outliers are weighted down: otherwise slightly wrong slopes would
turn the largest changes of exposure, the most informative ones, into outliers."""

SLOPE_FACTOR_LIMITS = (0.8, 1.25)
"""Limits of the factor on the slopes that is fitted with the noise model: the bins determine the slopes to within a
quarter, and smooth noise could otherwise explain smooth exposures on its own."""

INEXACT_SLOPE_FACTOR_LIMITS = (0.8, 8.0)
"""The same if single exposures are inexact: their errors make the slopes of the bins too small."""

INEXACT_OUTLIER_FACTOR = 4.0
"""If single exposures are inexact, residuals up to this multiple of their mean are not outliers: most changes may be
pure errors, and the few real ones must not look like the outliers."""

REWEIGHTING_TOLERANCE = 1e-6
"""Change of the slopes, and relative change of the scale, below which they have converged: near its maximum the
likelihood changes far less."""

MAX_AR_SUM = 0.98
"""Largest sum of the magnitudes of the autoregressive coefficients: below one, so that the noise is stationary."""

AR_RIDGE = 1e-3
"""Ridge on these, relative to the mean diagonal of the normal matrix: noise-free recordings do not determine them."""

MIN_FITTED_LOG_CHANGE = 1e-9
"""Change of ln exposure below which it is mere rounding, and no slope is fitted."""

# Acceptance of a lag (ospc.exposures.lag_selection)

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
"""Minimum share of the energy of fast exposure changes at the period of the flicker if they follow it. Noise of the
exposure control keeps it below one; changes that share the period by chance have less."""

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
"""Errors of single exposures that are tried, relative to the other noise: two clearly different sizes, so that a
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
"""Minimum number of pairs of frames before a change: fewer may all show one passing cloud that the exposure control
follows, so that the earlier lag was less certain than it seemed."""

LAG_CHANGE_START_TOLERANCE = 1.0
"""Log likelihood that may be sacrificed for a later start of the change, so that uninformative pairs do not count as
changed."""

SUSPECTED_LAG_CHANGE_LEAD = 4.0
"""Log likelihood by which another lag must lead before more frames are compared. One in ten checks of unchanged film
reaches this; without the additional frames it took up to half a minute to prove a change."""

LATER_LAG_LEAD, EARLIER_LAG_LEAD = 25.0, 50.0
"""Log likelihood that proves that exposures are later or earlier than before. Light followed by a smooth exposure
control looks like earlier ones. In ten hours of unchanged film, the largest false leads were 21 and 32."""

MIN_LIGHT_PERIOD_FRAMES = 48
"""Shortest period of light changes that are distinguished from exposures: a second at 50 frames/s. While light
drifts, an exposure that changes its rate seems late or early; without this allowance, false leads reach 60."""

# Flicker (ospc.exposures.flicker)

MIN_FLICKER_FRAMES = 24
"""Minimum length of a run that is searched for a line: a wave of free frequency and phase fits anything shorter."""

MIN_FAST_PERIODS = 4
"""Fewest observed periods of a fast change: slower ones come from the scene or an exposure control."""

MIN_WAVE_PERIODS = 2
"""Fewest observed periods of any line: with fewer it cannot be distinguished from a trend."""

FOURIER_OVERSAMPLING = 8
"""Length of the Fourier transform relative to that of the values: a line between two of its frequencies loses at most
1 per cent of its power, and its frequency is found as precisely as the values allow."""

MIN_FLICKER_SHARE = 0.4
"""Minimum share of the fast changes explained by a line: otherwise something else changes the brightness more."""

FLICKER_CHANCE = 1e-4
"""Probability with which noise alone may produce such a line: small, because many lags are tested per recording."""

MAX_FLICKER_SHARE = 0.999
"""Upper limit of the share from which that probability is computed: rounding leaves no more even for a pure wave."""

MIN_FLICKER_LOG = 0.003
"""Minimum amplitude of a flicker, in ln of the grey level from frame to frame: a shaking camera imitates weaker ones
through registration errors."""

FLICKER_CLIP_SIGMAS = 4
"""Values further from the median than this, in robust standard deviations, are clipped before lines are searched for:
the flat spectrum of a scene cut or a passing hand would hide every line."""

MIN_FLICKER_SCATTER_LOG = 1e-6
"""Minimum scatter assumed for that, in ln of the grey level: rounding errors of simulated images are not clipped."""

MAX_PHASE_GAP_FRAMES = 8
"""A run is continued across fewer missing frames than this: over longer gaps the phase of a wave is lost."""

# Unexplained brightness changes (ospc.exposures.brightness_report)

NOTABLE_RMS_LOG = 0.006
"""Root mean square of the unexplained change of ln brightness per frame up to which nothing is doubted: registration
alone leaves this much."""

DRIFT_FRAMES = 40
"""Number of frames over which unexplained changes are added up: an exposure control acts within this time, and
registration errors do not yet add up to much."""

DRIFT_STEP_FRAMES = DRIFT_FRAMES // 4
"""Number of frames between the starts of these windows, which overlap so that no swing is cut in two."""

UNCHANGED_EXPOSURE_LOG = 1e-4
"""Change of ln exposure up to which it counts as unchanged: rounding in files, but no step that a camera makes."""

STALE_DRIFT_LOG = 0.12
"""Drift of ln brightness above which an exposure that never changes counts as stale, however small each step is:
within `DRIFT_FRAMES`, an exposure control changes it by more, registration errors by less."""

MIN_STALE_PAIRS = 12
"""Fewest pairs of unchanged exposure for it to count as stale: their root mean square is known to a fifth."""

REPORTED_FLICKER_SHARE = 0.6
"""Minimum share of the fast unexplained changes for a flicker to be reported: more than :func:`find_flicker`
requires, because a false report would send the user looking for a lamp."""

REPORTED_FLICKER_TOTAL_SHARE = 0.4
"""Minimum share of the variance of all unexplained changes for a flicker to be reported. The slow swings of a control
loop also have a strongest frequency, but with a smaller share."""

HARMONIC_TOLERANCE_TURNS = 0.1
"""Deviation from a whole number of turns per cycle of exposures up to which a flicker is a harmonic of the cycle."""

RMS_KEPT_SHARE = 0.98
"""Share of the changes, the smaller ones, used for a root mean square: a scene cut is no change of light."""

JUMP_SIGMAS = 10.0
"""Minimum size of a jump, in robust standard deviations of the unexplained changes. Failed registrations and moving
objects give them heavy tails, so a few standard deviations are common."""

MIN_JUMP_LOG = 0.04
"""Minimum size of a jump, in ln of the grey level: smaller ones are not worth reporting even without noise."""

JUMP_FRAMES = 4
"""Frames before and after a jump within which it must not be reversed: a passing hand takes longer than one."""

LASTING_JUMP_SHARE = 0.6
"""Share of a jump that must remain over these frames: noise and drift over a few frames remove less than the rest."""

MAX_JUMPS_SHARE = 0.1
"""Share of pairs with jumps above which none is reported: jumps are then the rule, and the exposures do not fit."""

# Local tone mapping (ospc.exposures.tone_mapping)

MIN_TONE_PAIRS = 10
"""Fewest pairs of frames for a result: samples of one pair share errors, so the number of pairs matters."""

MAX_TONE_PAIRS = 120
"""Most pairs used, spread over the recording: more take longer, and properties of the camera show in fewer."""

MIN_TONE_SAMPLES = 2000
"""Fewest points over all pairs: about fifteen unknowns are fitted to them before image regions are compared."""

MAX_TONE_LOG_CHANGE = 1.5
"""Largest change of ln exposure used: beyond it, most points are clipped in one of the frames."""

TONE_CELLS = (4, 3)
"""Number of compared image cells, across and down: roughly square, and large enough for several samples each."""

MIN_TONE_CELL_SAMPLES = 8
"""Minimum number of samples for a cell's median: one or two outliers do not move it far."""

MIN_TONE_CELLS = 3
"""Minimum number of compared cells of a pair: two are equally far from their median."""

TONE_REWEIGHTINGS = 4
"""Number of reweighting rounds; a linear fit with this many samples converges quickly."""

TONE_HUBER_SIGMAS = 2.0
"""Residual, in robust standard deviations, above which weights decrease (Huber): moving objects, wrong matches."""

CLEAR_TONE_SPREAD_LOG = 0.015
POSSIBLE_TONE_SPREAD_LOG = 0.006
"""Differences between regions within one frame, in ln of the grey level, that are clear and possible signs of local
tone mapping. Without it they were at most 0.011 in 48 simulated recordings, and at most 0.0044 in all but one."""

# The verdict on the exposures (ospc.exposures.findings)

MAX_UNEXPLAINED_SHARE = 0.25
"""Share of the energy of brightness changes not explained by the exposures above which these are doubted: the
residual is then half as large as the changes themselves."""

MIN_CHECKED_FRAMES = 40
"""Recordings with fewer frames, such as a series of photographs, are not doubted for being too short to check."""

DOUBTED_LAG_FRAMES, DOUBTED_LAG_SIGMAS = 0.3, 5.0
"""Fitted lag of the exposures, in frames and in standard deviations, above which they may belong to other frames. In
125 clean recordings with the right lag it was at most 0.09 frames and 2.3 standard deviations; in the one with a
wrong lag, 0.6 and 7.8."""

BLENDED_LAG_FRAMES = 0.03
"""Fitted early exposures, in frames, above which each image seems to contain part of the previous one. In recordings
coded as H.264 or MPEG-4, they were 0.02 to 0.15 frames early, and the response was off by up to 4.4 standard
deviations; those of the same images without coding were at most 0.005 frames early."""

REFUTED_LAG_FRAMES = 0.5
"""A correction by whole frames is refuted if the fitted lag, in frames, exceeds this for the corrected exposures but
not for the recorded ones. Three of 100 clean recordings, with slow exposures and a camera moving forward, were
corrected by a frame in error; their fits showed 0.65, 0.7 and 0.98."""

# Wrong exposures (ospc.exposures.wrong_exposures)

MIN_WRONG_LOG, MIN_SHOWN_SHARE = 0.5, 0.1
"""Least ln by which an exposure that may be wrong differs from those before and after it, and share of it by which
grey levels would follow at least: those of logarithmic cameras change by a sixth of ln exposure."""

MAX_WRONG_SHARE = 0.05
"""Largest number of such exposures relative to the compared pairs of frames. If there are more, all are doubtful."""
