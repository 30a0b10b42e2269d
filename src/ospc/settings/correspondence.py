"""Constants of preprocessing, registration and sampling: their meaning, unit and the reason for their value."""

from __future__ import annotations

import numpy as np

# Preprocessing (ospc.correspondence.preprocessing)

COMPARED_QUANTILES = np.linspace(0.05, 0.95, 19)
"""Quantiles of grey level at which the brightness of two images is compared; noise and clipping affect the ends."""

SURROUND_SIGMA = 0.1
"""Standard deviation of the reach of light scattered nearby, in image widths: between that of bloom, a few pixels,
and veiling glare, the whole image. Local tone mapping has a similar reach."""

SURROUND_WIDTH_PX = 64
"""Width of the coarse image in which surroundings are averaged: the means are smooth over six of its pixels."""

MIN_FLAT_AREA_RATIO = 2.0
"""Minimum area over which the image must be flat, relative to the area over which grey levels are averaged:
registration may be off by a pixel, and the image must be flat there, too."""

IMPULSE_CONTRAST, IMPULSE_DEVIATIONS = 0.1, 6.0
"""A pixel that differs from the median of its surroundings by more than this share of white, plus this multiple of
the usual deviation around it, counts as a defect (a dead pixel, a transmission error), and averages use the median
instead. In a clean frame with texture, one pixel in 1500 is replaced. Registration uses the unmodified images: with
chart lines treated as defects, a stationary camera seemed to move."""

MIN_SMOOTHING_VARIANCE = 0.04
"""Minimum variance of a smoothing, in square pixels: narrower ones have no effect."""

# Thumbnails (ospc.correspondence.thumbnail)

THUMBNAIL_SIDE_PX = 160
"""Longest side of a thumbnail in pixels: 19 000 points, by which neighbouring frames are compared in a
millisecond."""

THUMBNAIL_SMOOTHING_PX = 1.0
"""Standard deviation of the smoothing of grey levels, in thumbnail pixels: about the registration error."""

THUMBNAIL_GRADIENT_SMOOTHING_PX = 1.2
"""Standard deviation of the additional smoothing before gradients are taken, in thumbnail pixels: a flat point must
be flat within the registration error."""

DARKEST_EXPOSED_LEVEL, BRIGHTEST_EXPOSED_LEVEL = 0.04, 0.97
"""Grey levels beyond which a point counts as clipped: some pixels of a mean are clipped before the mean is."""

THUMBNAIL_CLIP_MARGIN_PX = 2
"""Points this close to a clipped one are not used, in thumbnail pixels: twice the smoothing."""

# Registration of thumbnails (ospc.correspondence.thumbnail_registration)

MIN_OVERLAP = 0.25
"""Minimum share of the points of one view that must be found in the other. With less, most matches are chance matches
of equal grey level, regardless of the exposures: such pairs were wrong by a factor of two on average, others by half
a per cent."""

THUMBNAIL_MARGIN_PX = 2
"""Points closer to the border of the second thumbnail are not used, in its pixels."""

THUMBNAIL_SEARCH_STRIDE_PX = 6
"""Distance between the 8-pixel patches that are matched, in thumbnail pixels: OpenCV's 4 takes twice the time, and ln
M of a grey bin differs by only 0.0001."""

MAX_THUMBNAIL_ERROR_PX = 1.0
"""Largest forward-backward registration error of a point, in thumbnail pixels."""

MIN_REGISTERED_SIDE_PX = 32
"""Dense inverse search needs a few patches along each side; smaller images are treated as stationary."""

MIN_EXPOSED_SHARE = 0.99
"""Interpolated share of exposed pixels above which a point is exposed: all its neighbours are, up to rounding."""

# Equal brightness before registration (ospc.correspondence.exposure_normalizer)

DISPLAY_GAMMA = 2.2
"""Exponent of the scale on which images are registered, that of displays: noise and contrast vary little with
grey."""

DARKEST_COMPARED_GREY, BRIGHTEST_COMPARED_GREY = 8.0, 247.0
"""Grey levels, of 255, beyond which a quantile may be clipped."""

MAX_LOG_RATIO_DISAGREEMENT = 0.4
"""Largest difference, in ln, between the stated exposure ratio and that measured in the images for the stated one to
be used. The measured one has errors of this size while the response is unknown, and of a few hundredths
afterwards."""

CLEAR_LOG_RATIO_AGREEMENT = 0.2
"""Largest difference, in ln, between the stated exposure ratio and that of the grey quantiles for the stated one to
be used without further checks. Quantiles have smaller errors if the views overlap for the most part."""

MIN_SHARED_PLACES = 0.15
"""Share of the thumbnail points that two frames must have in common for their brightness to be compared point by
point; with fewer, the quantiles of their grey levels are compared."""

MAX_LOG_RATIO_SPREAD = 0.15
"""Standard deviation, in ln, of the ratios of single points up to which their median is trusted."""

MIN_KEPT_BRIGHTNESS = 0.5
"""Minimum brightness of the middle grey level of the longer exposure after normalisation, on the display scale,
relative to that in the frame. Of responses from black to white, the logarithm of 1 to 51 keeps 0.77; with grey levels
ending at 128, quick fits kept a thousandth or less, and moving cameras seemed stationary."""

MIN_IRRADIANCE = 1e-6
"""Lower limit of the irradiance before taking its logarithm: below the first grey level of any camera."""

# Dense registration (ospc.correspondence.registration)

SECOND_SEARCH_STEPS, SECOND_SEARCH_STRIDE_PX = 8, 5
"""Descent steps per patch and distance between patches, in pixels, of the search for what a homography leaves: a
third of OpenCV's steps on a coarser grid. The preceding search needs all steps: with fewer, half of a pair's
information about the vignette was lost."""

REFINEMENT_ITERATIONS, REFINEMENT_GRADIENT_WEIGHT = 5, 20.0
"""Iterations of the variational refinement (OpenCV's value for this quality), and weight of gradient constancy
relative to the smoothness of the displacements: twice OpenCV's default, because there is no other data term."""

HOMOGRAPHY_SPACING_PX, HOMOGRAPHY_MIN_ROWS = 16, 12
"""Distance in pixels between the points to whose coarse displacements a homography is fitted, and minimum number of
rows and columns of points, which are closer together in small images. There are several hundred of them."""

HOMOGRAPHY_INLIER_PX = 2.0
"""Largest error, in pixels, of a coarse displacement that supports the homography: the next search easily corrects
it."""

HOMOGRAPHY_MIN_INLIERS = 16
"""Fewest points that must support a homography: one through four points fits them whatever their errors."""

JACOBIAN_CELL_PX = 32
"""Side of the squares over which displacements are averaged before they are differentiated, in pixels of the small
images. With squares of 8 pixels, area ratios were off by 3 %, enough to shift the vignette centre in films that only
move sideways."""

# Keyframe selection (ospc.correspondence.keyframe_selection)

AGE_CLASSES = 26
"""Number of classes of age in frames, two per doubling: up to 5800 frames."""

PRIOR_OVERLAP, PRIOR_RADIAL_MOTION = 0.8, 0.01
"""Overlap, and radial motion in half diagonals, expected of the youngest class before any comparison. Each further
class is expected to overlap like the previous one, and to have moved in proportion to its age."""

MAX_PRIOR_RADIAL_MOTION = 0.3
"""Largest expected radial motion, in half diagonals."""

AGE_CLASS_RATIO = 2.0**0.5
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

NODE_STEP_PX = 2
"""Distance between the nodes from whose values a wider smoothing is computed, in reduced pixels: for the usual
stretches, up to 1.25, about the distance at which three nodes represent a Gaussian (Gauss-Hermite)."""

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

# A stationary camera (ospc.correspondence.static_series)

SERIES_BRIGHTNESS_CELLS = 64
"""Number of equal ranges of ln brightness from which pixels are taken in turn: dark and bright ones are rare but the
most informative."""

# The image circle of a fisheye (ospc.correspondence.image_circle)

MIN_CIRCLE_FRAMES = 8
"""Minimum number of frames before a dark point counts as surround: in a single frame the scene itself may be dark."""

LIT_QUANTILE = 0.9
MIN_LIT_GREY = 60
"""Grey level, of 255, that the brightest tenth of the image must reach: in the dark, scene and surround look
similar."""

MAX_SURROUND_SHARE = 0.1
"""Grey level of the surround relative to the brightest tenth: a little stray light reaches it. A higher limit would
include dark parts of the scene."""

MIN_SURROUND_AREA = 0.01
"""Smallest share of the image that counts as a surround: less is strong vignetting in the extreme corners."""

MIN_SURROUND_CORNERS = 3
"""Minimum number of corners in the surround: a decentred image circle may miss one, a dark wall covers two."""

SURROUND_MARGIN_PX = 3
"""Widening of the surround, in small pixels: the edge of the circle is blurred, and light falls off steeply there."""

WHOLE_IMAGE_RADIUS = 0.97
"""If the usable radius reaches this value, the image counts as usable up to its corners."""

# Statistics of grey values (ospc.correspondence.pixel_statistics)

MAX_COUNTED_FRAMES = 1024
"""Maximum number of frames whose statistics are kept individually; beyond it, every second one is dropped, which
bounds the memory of endless runs."""

MAX_GREY_RANGES = 100
"""Number of latest changes of black and white that are kept: usually there is one, in the first frames."""

COVERAGE_GREY_CELLS = 32
"""Number of equal grey ranges whose coverage is reported: one per interval between the knots of the response."""

COVERAGE_RADIUS_CELLS = 10
"""Number of equal ranges of radius, from the centre to the corner, whose coverage is reported."""

COUNTED_STRIDE = 2
"""Every n-th row and column is counted: a quarter of the pixels has the same distribution."""

COMPARED_COLUMNS_PX, LEAST_ROW_VARIANCE = 8, 3e-7
"""Number of columns whose mean is compared from row to row, and regularisation of the variance of the differences, in
white squared: that of quantisation to 8 bits."""

INTERLACED_QUANTILE, MIN_INTERLACED_ALTERNATION = 0.75, 0.65
"""Quantile over frames of the alternation between rows, and its limit for interlaced images: without motion, rows do
not alternate. In 45 recordings of all kinds, with compression and with noise of rows or pixels, it was at most 0.35;
with every other row from the next frame, at least 0.78; with doubled or interpolated rows, at most 0."""

MIN_COVERED_SHARE = 0.001
"""Minimum share of all pixels for a grey range to count as covered: less is noise, lettering or a reflection."""

BLACK_PLACE_LEVEL = 0.045
"""Grey level of a thumbnail below which a point is black: stray light, noise and a black level of a few grey values
stay below it."""

USED_SHARE = 0.25
"""Highest grey value, relative to the largest one stated for a sensor of more than 8 bits, up to which that statement
is doubted: two bits or more are unused."""

MIN_MEDIAN_LEVEL = 0.15
"""Median of the points' largest grey levels below which black points are not assessed, because the scene is dark."""

MIN_BORDER_SHARE = 0.002
"""Smallest share of the image that is reported as a black surround, about forty points of a thumbnail: less is a dark
object at the edge."""

RECTANGLE_FILL = 0.95
"""Share of its bounding box above which the lit region is a rectangle in a black border; a disc fills π/4 of it."""

MIN_PILE_SHARE = 0.005
"""Minimum share of pixels at black or white inside the scale."""

WHITE_NEIGHBOURHOOD = 2 / 255
"""For the highest grey value to be white, all others within this distance below it must have fewer pixels in total:
if only a few grey values occur, each has a large share. White had at least four times as many in 20 films."""

HIGHEST_BLACK = LOWEST_WHITE = 0.2
"""Upper limit of black and lower limit of white. White between grey values 76 and 128 had at least 0.009 of all
pixels; in 39 dark films without clipping, the highest grey value had less than 0.0005."""

WHITE_LEVELS = 256
"""Number of grey levels at which scattered values of white are counted: those of 8 bits."""

LOWEST_SCATTERED_WHITE, MAX_WHITE_SCATTER, WHITE_EDGE = 0.75, 8, 0.25
"""Lower limit of white whose values scatter, the largest width of their peak in the histogram in 8-bit grey values,
and the height of its edges relative to the top. A real camera's white was 249 ± 1, a quarter as frequent at 248 and
251 as at the top. Uniform objects have wider peaks, because of the vignette and because exposures differ."""

MIN_WHITE_CONTRAST, MAX_BEYOND_WHITE_SHARE = 4, 0.02
"""Minimum height of this peak relative to the histogram below it, and maximum number of pixels beyond it relative to
those in it: 7 and 0.005 with the real camera."""

LOG_EXPOSURES_OF_WHITE = 0.2
"""Range of ln exposure of the frames with this peak beyond which it is white: other grey levels change with the
exposure."""

MAX_LOG_EXPOSURE_BELOW_WHITE, BRIGHTEST_SHARES, MIN_CELLS_OF_CLIPPED = 1.2, (0.1, 0.9), 2
"""If all frames with this peak have about the same exposure, frames with exposures shorter by up to this in ln are
considered: there, the quantiles of as many of the brightest pixels at these shares have to be at least this many of
the 32 ranges of grey apart. They are 2 or 3 apart in a real video; those of a uniform object are at most 1 apart."""

MIN_MISSING_LEVELS_SHARE = 0.05
"""Share of missing grey values between the extremes above which they are reported: a few rare ones miss by chance."""

MIN_COMB_RANGE = 32
"""Minimum distance between the extremes, in grey values, for counting missing ones: a dark image has few values."""

# Observations (ospc.observations)

CLIPPED_MARGIN = 1 / 255
"""Distance from black or white up to which a grey level counts as clipped: one 8-bit grey value. An extreme value
this close to the end of the scale is ordinary clipping."""

POSITION_TOLERANCE = 0.02
"""Share of the half diagonal by which a position may lie beyond the corner: half a pixel plus rounding."""
