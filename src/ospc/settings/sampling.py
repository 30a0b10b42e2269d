"""Constants of keyframes and scene points: their meaning, unit and the reason for their value."""

# Keyframe selection (ospc.correspondence.keyframe_selection)

AGE_CLASSES, AGE_CLASSES_PER_DOUBLING = 26, 2
"""Number of classes of age in frames, and how many there are per doubling of the age: up to 5800 frames."""
PRIOR_OVERLAP, PRIOR_RADIAL_MOTION = 0.8, 0.01
"""Overlap, and radial motion in half diagonals, expected of the youngest class before any comparison. Each further
class is expected to overlap like the previous one, and to have moved in proportion to its age."""
MAX_PRIOR_RADIAL_MOTION = 0.3
"""Largest expected radial motion, in half diagonals."""
AGE_CLASS_RATIO: float = 2.0 ** (1 / AGE_CLASSES_PER_DOUBLING)
"""Ratio of the ages of successive classes."""
PRIOR_COMPARISONS = 1.5
"""Weight of these expectations, in comparisons: the first real comparisons soon outweigh them."""
MAX_COMPARISONS = 100
"""Maximum weight of past comparisons: the camera may have moved at another speed earlier."""
RESPONSE_TURN = 3
"""One in this many selections optimises the response, about which a pair reveals more than about the vignette."""
EXPOSURE_CHANGE_WEIGHT = 0.01
"""Weight of a squared change of exposure when selecting for the vignette: it breaks ties between equal motions."""
MIN_INFORMATION = 1e-6
"""Information assumed of a comparison without change of exposure or motion, so that overlap decides between these."""
OVERLAP_POWER = 1.5
"""Information grows with this power of the overlap: besides the number of shared points, registration improves."""
OLDEST_AGE_FACTOR = 1.5
"""Age of a hypothetical keyframe before the oldest, relative to it: it determines when the oldest is dropped."""

# Sampling of flat points (ospc.correspondence.flat_sampling)

SAMPLING_MARGIN_PX = 5
"""Points closer to the border than this, in reduced pixels, are not used: their surroundings are not seen whole."""
SAMPLING_GREY_CELLS, SAMPLING_RADIUS_CELLS = 8, 4
"""Numbers of ranges of the square root of grey level and of radius. If there are too many scene points, they are
taken from these ranges in turn; otherwise the sky or a wall would make up most of them."""
MIN_MOTION_PLACES = 100
"""Minimum number of matched points for measuring the motion."""
STRUCTURE_QUANTILE = 0.8
"""Quantile of the gradient above which a point shows motion: at flat points, registration interpolates."""
MOTION_PARTS_PER_SIDE = 4
"""Number of image tiles along each side within which displacements are averaged as vectors, so that noise cancels."""
MIN_PART_PLACES = 8
"""Fewest points in such a tile: with fewer, noise does not cancel, and a stationary camera seems to move."""

# Equal smoothing of both views (ospc.correspondence.equal_smoothing)

NODES_PER_SIDE = 5
"""Number of pixels along each axis from whose values a wider smoothing is computed: five reproduce the variance and
the fourth moment of the additional Gaussian, up to a stretch of 1.25. With three at a distance of two pixels, the
scene looked 0.1 % darker in a view of 0.92 times the scale, differently in each part of the image; the mean error of
the vignette of 21 forward drives was 1.11 times, its median 1.5 times as large."""
PIXEL_VARIANCE = 1 / 12
"""Variance of the position within a pixel, which averages too, in square pixels."""
MAX_STRETCH = 1.6
"""Largest stretch between two views, and the inverse of the smallest: about that between the centre and the corner of
a 75° view. Larger values are registration errors at depth edges."""

# Noise of single pixels (ospc.correspondence.noise_estimation)

NOISE_BINS = 16
"""Number of equal grey ranges in which noise is measured: it varies little within one, and each has enough blocks."""
NOISE_BLOCK_PX = 8
"""Side of a block in pixels: small enough to fit between structures, and its 64 values give a variance to a fifth."""
MIN_BAND_SPACING_ROWS, MAX_BANDS = 24, 20
"""Fewest rows between the starts of bands of blocks, and most bands: a third of a 640×480 image is enough."""
NOISE_QUANTILE = 0.1
"""Quantile of the blocks' variances that is attributed to noise alone: hardly any image has structure in more than
nine tenths of its blocks."""
NOISE_QUANTILE_RATIO = 0.627
"""A tenth of the blocks of pure noise have a variance below this share of the true one."""
MIN_NOISE_BLOCKS = 40
"""Minimum number of blocks of a grey range in a frame: a tenth of them is then four."""
NOISE_FRAMES = 64
"""Number of latest frames whose variances are kept; with more, their median hardly changes."""
MIN_END_DISTANCE_SIGMAS = 4
"""Distance from black and white, in standard deviations of the noise, at which a range shows its full noise. Closer,
only blocks with little noise count as exposed."""
QUANTISATION_VARIANCE = 1 / 12
"""Variance of rounding to integer grey values: the least noise of any image."""
ASSUMED_NOISE_SIGMA = 0.5 / 255
"""Standard deviation assumed if nothing was measured: half an 8-bit grey level."""
GAIN_BEGINS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Quantiles of ln exposure that are tried as the exposure from which the gain increases."""
GAIN_ITERATIONS = 5
"""Iterations for the robust weights of variances: structure in some blocks adds to their noise."""
GAIN_SPREAD = 0.1
"""Smallest standard deviation of ln exposure beyond that exposure, within a grey range: a power needs a range."""
MIN_GAIN_VARIANCES = 60
"""Minimum number of variances for estimating the growth with gain."""
MIN_AMPLIFIED_RATIO = 4.0
"""Minimum ratio of a variance to that of quantisation, which gain does not amplify."""
MAX_GAIN_RESIDUAL = 0.4
"""Largest mean residual of ln variance with growth, relative to that without. It was below 0.4 in ten simulated
recordings with gain, and above in all of 450 without."""
MIN_GAIN_POWER, MAX_GAIN_POWER = 0.8, 2.0
"""Growth of ln variance with ln exposure from which it is attributed to gain, and the largest one. It is 1 for shot
noise and 2 for read noise, and was 1.3 to 1.5 in these recordings. Structure imitates it, seldom beyond 0.8."""

# A stationary camera (ospc.correspondence.static_series)

SERIES_PIXELS = 12_000
"""Number of pixels kept: eight times the scene points of the presets, so that they include dark and bright ones."""
SERIES_FRAMES = 256
"""Maximum number of frames kept; beyond it, every second one is dropped and only every second new one is kept."""
SERIES_BRIGHTNESS_CELLS = 64
"""Number of equal ranges of ln brightness from which pixels are taken in turn: dark and bright ones are rare but the
most informative."""

# Observations (ospc.observations)

GREY_POWERS = 5
"""Powers of the grey level whose means are kept. A polynomial of this degree approximates the inverse of smooth
responses to 1 or 2 per cent, and glare is a few per cent of the mean irradiance. With three powers, dark surroundings
were wrong by a fifth for the simulator's filmic and logarithmic responses."""
CLIPPED_MARGIN = 1 / 255
"""Distance from black or white up to which a grey level counts as clipped: one 8-bit grey value. An extreme value
this close to the end of the scale is ordinary clipping."""
POSITION_TOLERANCE = 0.02
"""Share of the half diagonal by which a position may lie beyond the corner: half a pixel plus rounding."""
