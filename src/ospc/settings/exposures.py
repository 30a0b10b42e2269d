"""Constants of the assessment of exposures: what each is, its unit, and why it has this value."""

from __future__ import annotations

import numpy as np

# Changes of brightness between two frames (ospc.exposures.brightness)

GREY_BIN_EDGES = np.array([0.05, 0.09, 0.14, 0.20, 0.27, 0.35, 0.44, 0.54, 0.65, 0.78, 0.93])
"""Edges of the grey bins: the same change of exposure changes ln M by different amounts at different grey levels.
Bins are narrower where responses are steeper; black and white, where noise is clipped, are left out."""
GREY_BIN_EDGES.setflags(write=False)

MIN_BIN_PIXELS = 40
"""Fewest places that a bin's mean, or the median motion, is taken of: the standard error is a sixth of the scatter.
With fewer, one moving object would decide; with more, small images would leave bins empty."""

MAX_BIN_WEIGHT = 5000.0
"""Most places that a bin counts as; otherwise one large even surface, whose errors have one cause, decides alone."""

MAX_RELATIVE_GRADIENT = 0.04
"""Steepest flat place: gradient over grey level, per thumbnail pixel. A registration error of a tenth of a pixel then
changes ln M by 0.004 at most; a lower limit would leave too few places in textured scenes."""

BIN_OUTLIER_SIGMAS = 2.5
"""Places further from their bin's median, in robust standard deviations, are left out of its mean: moving objects,
gloss, wrong registrations. Of normally distributed values 99 per cent stay."""

MIN_BIN_SCATTER_LOG = 1e-4
"""Least scatter assumed in a bin, in ln of the grey level: rounding errors of nearly equal values are kept."""

PIXEL_SAMPLES_PER_PAIR = 400
"""About how many single places of a pair are kept: some thirty in each cell of local tone mapping."""

MOTION_STRIDE = 5
"""The motion is measured at one in so many places: neighbours move alike, so that more cost time and add nothing."""

MIN_MOTION_GRADIENT = 0.01
"""Least gradient, in full scale per thumbnail pixel, of a place whose displacement is measured: registration fills in
flatter ones from their surroundings."""

DARKEST_LEVEL = 1e-3
"""Lowest grey level whose logarithm is taken, a quarter of an 8-bit level; darker ones are taken for this."""

# Which changes of brightness are used (ospc.exposures.brightness_series)

AR_ORDER = 2
"""Order of the autoregressive noise: neighbouring pairs share a frame, and errors of registration swing back."""

MIN_PAIR_WEIGHT = 100.0
"""Fewest places that a pair of frames is used with: fewer are often wrong together, on one object that moves."""

MAX_BIN_DEVIATION_LOG = 0.02
MAX_BIN_DEVIATION_SHARE = 3.0
"""Difference from the middle bin, in ln of the grey level, up to which a bin is used: a constant for errors of
registration, and a multiple of the middle change, since the slope of a response differs by as much between bins."""

# How many changes of brightness are kept (ospc.exposures.brightness_history)

MAX_BRIGHTNESS_CHANGES = 1200
"""Most changes of brightness kept: the likelihood of a lag then takes a tenth of a second."""

MAX_CHANGES_WITH_SAMPLES = 160
"""Changes of brightness whose single places, which take most memory, are kept: enough for local tone mapping."""

MAX_REPEATED_FRAMES = 1000
"""Most repeated frames whose numbers are kept: enough to look through, however endless the run."""

# When the exposures are assessed (ospc.exposures.monitor)

FIRST_ASSESSMENT_CHANGES = 39
"""Changes of brightness before the exposures are assessed the first time: fewer seldom settle a lag."""

ASSESSMENT_GROWTH = 1.5
"""Exposures are assessed again whenever there are so many times more changes of brightness."""

LAG_SEARCH_CHANGES = 400
"""Changes of brightness beyond which a lag that is still not known is looked for in the usual runs of frames only."""

LAG_CHECK_INTERVAL_CHANGES, SUSPECTED_LAG_CHECK_INTERVAL_CHANGES = 16, 8
"""Changes of brightness from one look for a change of the lag to the next, and while one is suspected: five seconds
of film late in a run, at a hundredth of its time, and half a second."""

EXPOSURE_CHANGE_FRAMES = 8
"""Frames around a frame over which the exposure must change for it to tell the lag: the largest lag and some."""

MIN_EXPOSURE_CHANGE_LOG = 0.02
"""Change of ln exposure over these frames that shows in the images."""

# The course of the exposures (ospc.exposures.table)

CONSTANT_EXPOSURE_LOG = 0.005
"""Range of ln exposure below which it is constant: half a per cent is lost in the noise of registration."""

CHANGED_EXPOSURE_LOG = 0.01
"""Change of ln exposure from which a frame counts as exposed differently from the one before: 1 per cent."""

MAX_CYCLE_FRAMES = 60
"""Longest cycle of exposures looked for, in frames: brackets have less than ten, programmed sweeps some tens."""

MIN_CYCLES = 3
"""Fewest repetitions of a cycle within the recording: two may be alike by chance."""

SAME_EXPOSURE_LOG = 1e-3
"""Difference of ln exposure up to which two exposures are the same: rounding in files, and jitter of sensors."""

MIN_CYCLE_SHARE = 0.97
"""Share of the frames that must repeat a cycle: a few dropped frames do not break it."""

# The likelihood of a lag (ospc.exposures.lag_likelihood)

STUDENT_T_DOF = 4.0
"""Degrees of freedom of Student's t that drives the noise: its tails are heavy, and its variance is still finite."""

MAX_REWEIGHTINGS = 10
"""Most rounds of iterated reweighting, of either kind; by then the weights hardly change."""

MIN_NOISE_SCALE_LOG = 1e-4
"""Least scale of the noise, in ln of the grey level: rounding errors of images without noise must not decide."""

SLOPE_POOLING = 0.05
"""Weight of the common slope in each bin, over the mean weight of the bins: bins that were hardly seen follow the
others, and those that were seen hardly notice."""

RELATIVE_SLOPE_ERROR = 0.1
"""Relative error of the slopes that is allowed for when outliers are weighted down: otherwise slopes that are
slightly wrong would make outliers of the largest changes of exposure, the most informative ones."""

SLOPE_FACTOR_LIMITS = (0.8, 1.25)
"""Limits of the factor on the slopes that is fitted with the noise model: the bins know them to a quarter, and a
smooth noise would explain smooth exposures itself."""

INEXACT_SLOPE_FACTOR_LIMITS = (0.8, 8.0)
"""The same where single exposures are inexact: their errors make the bins give slopes that are too small."""

INEXACT_OUTLIER_FACTOR = 4.0
"""Residuals up to this times their mean are no outliers then: most changes may be errors alone, and the few real ones
must not seem to be the outliers."""

REWEIGHTING_TOLERANCE = 1e-6
"""Change of the slopes, and relative change of the scale, up to which they are settled: near its maximum the
likelihood then changes by far less."""

MAX_AR_SUM = 0.98
"""Largest sum of the magnitudes of the autoregressive coefficients: below one, so that the noise is stationary."""

AR_RIDGE = 1e-3
"""Ridge on these, over the mean diagonal of the normal matrix: recordings without noise leave them open."""

MIN_FITTED_LOG_CHANGE = 1e-9
"""Change of ln exposure up to which it is only rounding, and no slope is fitted."""

# Which lag is accepted (ospc.exposures.lag_selection)

MAX_COMMON_LAG = 3
"""Largest lag that is common, in frames; larger ones are believed only where nothing else fits."""

MIN_LAG_LEAD = 10.0
"""Log likelihood by which the best lag must lead. Taken literally that is 22000 to 1; the noise is not quite as
modelled, and a wrong lag spoils a calibration while an open one only leaves it marginal."""

MIN_LAG_SIGMAS = 2.0
"""Lead of the best lag over its standard error from pair to pair (Vuong 1989): few pairs with large leads do not
decide."""

FLICKER_LEAD_FACTOR = 1.5
"""Factor on both limits of the lead where flicker is fitted, too: it takes away most of what exposures of the same
period could show."""

UNCOMMON_LAG_FACTOR = 1.75
"""Factor on the standard deviations, and squared on the lead, by which an unusual lag must beat a usual one."""

MIN_DISTINCT_PAIRS = 5
DISTINCT_NOISE_SCALES = 0.5
"""Fewest pairs in which two lags must predict different changes of brightness, and by how much, over the scale of the
noise: a single change of exposure, or a single wrong one, does not decide."""

MIN_EXPLAINED_SHARE = 0.05
"""Share of the energy of brightness changes that exposures must explain to be said to show in the images at all."""

FLAT_RESPONSE_SLOPE = 0.2
"""d ln M/d ln e of a flat response. If changes of brightness by this times the changes of exposure would be lost in
the noise, exposures that do not show have changed too little; otherwise images do not respond to them."""

CORRELATED_PAIRS = 4
"""Pairs of frames over which leads are taken to depend on each other: they share frames and objects."""

MIN_CORRELATED_VARIANCE_RATIO = 0.5
"""The variance of a mean is at least this share of what independent pairs would give: correlations are estimated from
few pairs, and must not make the mean look more certain than that."""

FRACTIONAL_LAGS = np.array([-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6])
"""Places next to a lag at which the fit is tried, in frames: to beyond the middle, to see the maximum."""

MAX_FRACTIONAL_LAG = 0.45
"""Largest distance of the best place from the lag, in frames: nearer to the middle, neither of the two is right."""

MIN_FRACTIONAL_LAG_LEAD = MIN_LAG_LEAD / 2
"""Log likelihood by which a place between frames must lead: half of what a lag needs, for it only raises a doubt."""

FLICKERING_EXPOSURE_SHARE = 0.87
"""Share of the energy of fast changes of exposure that has the period of the flicker if they follow it. An exposure
control's own noise keeps it below one; changes that share the period by chance have less."""

# The search for the lag (ospc.exposures.lag)

MAX_LAG = 5
"""Largest lag tried, either way, in frames: one to three are common, and each more costs a fit and a rival."""

MIN_LAG_PAIRS = 20
"""Fewest pairs that lags are fitted to: a fit has about twelve unknowns, and to fewer pairs any lag fits."""

MIN_PAIR_LOG_CHANGE = CONSTANT_EXPOSURE_LOG / 10
"""Change of ln exposure that some pair compared must exceed; otherwise the exposure was constant where it counts."""

MAX_FLICKERS = 2
"""Most periodic changes fitted beside the exposures: a lamp's frequency and its harmonic. More would fit anything."""

MAX_FLICKER_CANDIDATES = 3
"""Most frequencies tried for each of them; every one costs a fit of all lags."""

SAME_FREQUENCY = 0.01
"""Difference, in cycles per frame, up to which two frequencies are the same line: what a hundred frames resolve."""

MIN_FLICKER_LEAD = 15.0
"""Gain of log likelihood that a periodic change must bring. The best of 500 frequencies gains about ln 500 = 6 by
chance, more if the noise is not quite as modelled."""

LONG_INTERVALS_FRAMES = (4, 8)
"""Frames over which changes are compared where those from frame to frame settle nothing: an error of a single
exposure counts that much less against a steady change. Over more frames the scene is lost."""

AGREEING_LAG_SIGMAS = 2.4
OPPOSING_LAG_SIGMAS = 4.0
"""Standard deviations by which changes over long intervals must prefer a lag that changes from frame to frame prefer,
too, or one that they do not. More than for a lag elsewhere: long intervals overlap, and slow errors weigh more."""

MAX_LONG_INTERVAL_DEFICIT = 3.0
"""Log likelihood by which the lag from long intervals may be behind the best one from frame to frame: twenty times
less likely."""

DOUBTFUL_RESPONSE_SLOPE = 0.25
"""Median d ln M/d ln e below which a settled lag is tried again with inexact exposures. A gamma of 2.2 has 0.45;
errors of the exposures, like a wrong lag, make it look smaller."""

EXPOSURE_ERROR_SCALES = (2.0, 8.0)
"""Errors of single exposures that are tried, over what else drives the noise: two clearly different sizes, so that an
answer which depends on the size is not believed."""

SWINGING_EXPOSURE_SHARE = 0.5
"""Share of the energy of the exposures' changes from which one period is their main one."""

MAX_SWINGING_EXPOSURE_LOG = 0.1
"""Standard deviation of ln exposure up to which exposures may follow a swinging light: they swing no more than it
does. Chosen by hand: a higher limit would doubt programmed exposures, which vary more."""

# Whether the lag has changed (ospc.exposures.lag_change)

LAG_CHANGE_WINDOW_FRAMES = 400
"""Latest frames in which a change is looked for: twenty seconds at 20 frames/s, in which a few bursts of frames are
compared even late in a run."""

MIN_PAIRS_BEFORE_LAG_CHANGE = 100
"""Pairs of frames before a change: fewer can all be of one passing cloud, which an exposure control follows, so that
the lag was not known as well as it seemed."""

LAG_CHANGE_START_TOLERANCE = 1.0
"""Log likelihood that may be given away for a later beginning: pairs that tell nothing do not count as changed."""

SUSPECTED_LAG_CHANGE_LEAD = 4.0
"""Log likelihood by which another lag must lead for more frames to be compared. One look in ten at unchanged film
finds as much; without the additional frames it took up to half a minute to prove a change."""

LATER_LAG_LEAD, EARLIER_LAG_LEAD = 25.0, 50.0
"""The same for a proof that exposures come later or earlier than before. Light that a smooth exposure control follows
looks like earlier ones. In ten hours of unchanged film, the largest false leads were 21 and 32."""

MIN_LIGHT_PERIOD_FRAMES = 48
"""Shortest period of light that is told from exposures: a second at 50 frames/s. While light drifts, an exposure that
changes its pace seems to be late or early; unless this is allowed for, leads of 60 are false."""

# Flicker (ospc.exposures.flicker)

MIN_FLICKER_FRAMES = 24
"""Fewest frames of a run in which a line is looked for: a wave of free frequency and phase fits any fewer."""

MIN_FAST_PERIODS = 4
"""Fewest periods of a fast change within the time seen: slower ones are the scene's or an exposure control's."""

MIN_WAVE_PERIODS = 2
"""Fewest periods of any line within the time seen: with fewer it cannot be distinguished from a trend."""

FOURIER_OVERSAMPLING = 8
"""Length of the Fourier transform over that of the values: a line between two of its frequencies then loses 1 per
cent of its power at most, and coarser ones would place it less exactly than the values allow."""

MIN_FLICKER_SHARE = 0.4
"""Least share of the fast changes that a line makes up: otherwise something else changes brightness more."""

FLICKER_CHANCE = 1e-4
"""Probability with which noise alone may show such a line. Small, since many lags of each recording are looked at."""

MAX_FLICKER_SHARE = 0.999
"""Share from which that probability is computed at most; rounding leaves no more even of a pure wave."""

MIN_FLICKER_LOG = 0.003
"""Least amplitude of a flicker, in ln of the grey level from frame to frame: a shaking camera imitates weaker ones
through errors of registration."""

FLICKER_CLIP_SIGMAS = 4
"""Values further from the median, in robust standard deviations, are clipped before lines are looked for: a scene cut
or a passing hand has a flat spectrum, which would hide every line."""

MIN_FLICKER_SCATTER_LOG = 1e-6
"""Least scatter assumed for that, in ln of the grey level: rounding errors of simulated images are not clipped."""

MAX_PHASE_GAP_FRAMES = 8
"""Missing frames, less one, that a run may have between two values: over longer gaps the phase of a wave is lost."""

# What the exposures leave unexplained (ospc.exposures.brightness_report)

NOTABLE_RMS_LOG = 0.006
"""Unexplained root mean square change of ln brightness a frame up to which nothing is doubted: registration's own."""

DRIFT_FRAMES = 40
"""Frames over which unexplained changes are added up: an exposure control acts within them, and the errors of
registration do not yet add up to much."""

DRIFT_STEP_FRAMES = DRIFT_FRAMES // 4
"""Frames between the beginnings of these stretches, which overlap so that no swing is cut in two."""

UNCHANGED_EXPOSURE_LOG = 1e-4
"""Change of ln exposure up to which it counts as none: rounding in files, but no step that a camera makes."""

STALE_DRIFT_LOG = 0.12
"""Drift of ln brightness from which an exposure that never changes counts as stale, however small each step is: an
exposure control changes it by more within `DRIFT_FRAMES`, errors of registration by less."""

MIN_STALE_PAIRS = 12
"""Fewest pairs of unchanged exposure that can show it to be stale: their root mean square is known to a fifth."""

REPORTED_FLICKER_SHARE = 0.6
"""Share of the fast unexplained changes that a flicker makes up if it is reported: more than :func:`find_flicker`
asks for, since a line is tried beside a lag on less evidence than a user should be sent to the lamp for."""

REPORTED_FLICKER_TOTAL_SHARE = 0.4
"""Share of the variance of all unexplained changes that the reported flicker makes up. A control loop's slow swings
have a strongest frequency, too, but it makes up less of them."""

HARMONIC_TOLERANCE_TURNS = 0.1
"""Turns by which a flicker may miss a whole number within a cycle of exposures and still be its harmonic."""

RMS_KEPT_SHARE = 0.98
"""Share of the changes of which a root mean square is taken, the smaller ones: a scene cut is no change of light."""

JUMP_SIGMAS = 10.0
"""Least size of a jump, in robust standard deviations of the unexplained changes. Their tails are heavy, from failed
registrations and moving objects, so that a few times the standard deviation is common."""

MIN_JUMP_LOG = 0.04
"""Least size of a jump, in ln of the grey level: smaller ones are not worth a note, even where there is no noise."""

JUMP_FRAMES = 4
"""Frames before and after a jump in which it must not be taken back: a hand that passes by takes longer than one."""

LASTING_JUMP_SHARE = 0.6
"""Share of a jump that must remain for these frames: noise and drift of a few frames take away less than the rest."""

MAX_JUMPS_SHARE = 0.1
"""Share of the pairs above which jumps are the rule, and none is reported: the exposures do not fit at all."""

# Local tone mapping (ospc.exposures.tone_mapping)

MIN_TONE_PAIRS = 10
"""Fewest pairs of frames behind a result: samples of one pair err together, so that pairs are what counts."""

MAX_TONE_PAIRS = 120
"""Most pairs used, spread over the recording: more take longer, and what depends on the camera shows in fewer."""

MIN_TONE_SAMPLES = 2000
"""Fewest places of all pairs together: some fifteen unknowns are fitted to them before places are compared."""

MAX_TONE_LOG_CHANGE = 1.5
"""Largest change of ln exposure used: beyond, most places are clipped in one of the frames."""

TONE_CELLS = (4, 3)
"""Cells of the image, across and down, that are compared: about square, and large enough for several samples each."""

MIN_TONE_CELL_SAMPLES = 8
"""Fewest samples that a cell's median is taken of: an outlier or two do not move it far."""

MIN_TONE_CELLS = 3
"""Fewest cells of a pair that are compared: of two, both are equally far from their median."""

TONE_REWEIGHTINGS = 4
"""Rounds of iterated reweighting; a linear fit with so many samples settles quickly."""

TONE_HUBER_SIGMAS = 2.0
"""Residual, in robust standard deviations, from which on weights decrease (Huber): moving objects, wrong matches."""

CLEAR_TONE_SPREAD_LOG = 0.015
POSSIBLE_TONE_SPREAD_LOG = 0.006
"""Differences between parts of an image within one frame, in ln of the grey level, that are clear and possible signs
of local tone mapping. Without it they were 0.011 at most in 48 simulated recordings, and 0.0044 in all but one."""

# The verdict on the exposures (ospc.exposures.findings)

MAX_UNEXPLAINED_SHARE = 0.25
"""Share of the energy of brightness changes that exposures may leave unexplained before they are doubted: the rest is
then half as large as the changes themselves."""

MIN_CHECKED_FRAMES = 40
"""Recordings with fewer frames, such as a series of photographs, are not doubted for being too short to check."""

DOUBTED_LAG_FRAMES, DOUBTED_LAG_SIGMAS = 0.3, 5.0
"""Part of a frame by which a fit shows exposures to be late or early, and standard deviations, from which on they may
belong to other frames. With the right lag 125 clean recordings showed 0.09 of a frame and 2.3 standard deviations at
most; the one with a wrong lag showed 0.6 and 7.8."""

REFUTED_LAG_FRAMES = 0.5
"""Part of a frame by which a fit must show moved exposures to be wrong, and at most those as written. Three of 100
clean recordings, with slow exposures and a camera that moves forward, were moved by a frame; their fits showed 0.65,
0.7 and 0.98."""
