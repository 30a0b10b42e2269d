"""Constants of the assessment of exposures: their meaning, unit and the reason for their value."""

# When the exposures are assessed (ospc.exposures.monitor)

FIRST_ASSESSMENT_CHANGES = 39
"""Number of brightness changes before the exposures are first assessed: fewer rarely determine a lag."""
ASSESSMENT_GROWTH = 1.5
"""Exposures are assessed again whenever the number of brightness changes has grown by this factor."""
LAG_SEARCH_CHANGES = 400
"""Brightness changes after which a lag that is still unknown is searched for only in the regular runs of frames."""
LAG_CHECK_INTERVAL_CHANGES, SUSPECTED_LAG_CHECK_INTERVAL_CHANGES = 16, 8
"""Number of brightness changes between two checks for a change of the lag, normally and while one is suspected. Late
in a run, these are five seconds of video, which costs a hundredth of the run's time, and half a second."""
EXPOSURE_CHANGE_FRAMES = 8
"""Frames around a frame within which the exposure must change to be informative about the lag: the largest lag and
a margin."""
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
EVEN_STEP_LOG = 2e-3
"""Largest deviation of the steps of ln exposure from their mean at which the exposures change evenly: rounding to a
microsecond from 0.5 ms on. Rounding errors do not add up from frame to frame, so a lag hardly changes any ratio."""
MIN_CYCLE_SHARE = 0.97
"""Minimum share of the frames that repeat a cycle, so that a few dropped frames do not break it."""

# Flicker (ospc.exposures.flicker)

MIN_FLICKER_FRAMES = 24
"""Minimum length of a run that is searched for a line: a wave of free frequency and phase fits anything shorter."""
MIN_FAST_PERIODS = 4
"""Fewest observed periods of a fast change: slower ones come from the scene or auto exposure."""
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

# The verdict on the exposures (ospc.exposures.evidence, ospc.exposures.verdicts)

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
MAX_SETTLED_LAG_FRAMES = 0.5
"""Largest lag, in frames, that a fit may leave possible if it is to show that exposures belong to their frames: half
of the smallest lag by whole frames."""

# Wrong exposures (ospc.exposures.wrong_exposures)

MIN_WRONG_LOG, MIN_SHOWN_SHARE = 0.1, 0.1
"""Least ln by which an exposure that may be wrong differs from those before and after it, and share of it by which
grey levels would follow at least: those of logarithmic cameras change by a sixth of ln exposure. In nine recordings
with slow exposures, 126 of which were wrong by 0.4 in ln (one standard deviation), 81 were found with 0.1, 57 with
0.2 and 21 with 0.5; two of the 81 were wrong by less than 0.03. None was found in 24 recordings with right
exposures."""
MIN_UNIT_STEP_LOG = 1.5
"""Least step of ln exposure that no image near it shows and that is left out when the lag is searched for: with any
lag that moves it to frames that were not compared, the other exposures would seem to fit better."""
MAX_STEP_GAP_FRAMES = 20
"""Largest distance between compared frames before and after such a step that shows that it is not real although
others are. In a recording with three steps by a factor of 6.6, the light changed as much as the exposure within 40
frames, in the opposite direction."""
DOUBTED_WRONG_SHARE, MAX_WRONG_SHARE = 0.05, 0.1
"""Number of such exposures, relative to the compared pairs of frames, above which the other exposures are doubted,
too, and above which none can be told from the right ones."""
