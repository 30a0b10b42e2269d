"""Constants of preprocessing, registration and sampling: what each is, its unit, and why it has this value."""

from __future__ import annotations

import numpy as np

# Preprocessing (ospc.correspondence.preprocessing)

COMPARED_QUANTILES = np.linspace(0.05, 0.95, 19)
"""Shares of the pixels at whose quantiles the brightness of two images is compared; the ends are noise and
clipping."""

SURROUND_SIGMA = 0.1
"""Standard deviation of the distance over which light scattered nearby comes, in widths of the image: between that of
bloom, a few pixels, and veiling glare, the whole image. Local tone mapping reaches about as far."""

SURROUND_WIDTH_PX = 64
"""Width of the coarse image whose surroundings are averaged: the means are as smooth as six of its pixels."""

MIN_FLAT_AREA_RATIO = 2.0
"""Smallest area over which the image has to be flat, in areas over which grey levels are averaged: registration may
be off by a pixel, and the image has to be flat there too."""

IMPULSE_CONTRAST, IMPULSE_DEVIATIONS = 0.1, 6.0
"""A pixel that differs from the median of its surroundings by more than this share of white, and by so many times
what pixels around it usually do, is taken for a defect (a dead pixel, an error of transmission): the median takes its
place in means. Pixels of normal noise differ by 0.6 standard deviations, so noise hardly ever does that; of a clean
frame with texture, one pixel in 1500 is replaced. With a twentieth of the pixels black or white, κ of a filmic camera
is .0025, and that of a real video of dark rooms .003. With only those pixels replaced that are beyond all of their
neighbours, it was .004 and .009: adjacent defects hide each other. Images are registered as they are: where the lines
of a chart were taken for defects, a camera at rest seemed to move."""

MIN_SMOOTHING_VARIANCE = 0.04
"""Least variance of a smoothing, in square pixels: narrower ones change nothing."""

# Thumbnails (ospc.correspondence.thumbnail)

THUMBNAIL_SIDE_PX = 160
"""Longest side of a thumbnail in pixels: 19 000 places, by which neighbouring frames are compared in a
millisecond."""

THUMBNAIL_SMOOTHING_PX = 1.0
"""Standard deviation of the smoothing of grey levels, in thumbnail pixels: about the error of the registration."""

THUMBNAIL_GRADIENT_SMOOTHING_PX = 1.2
"""Standard deviation of the further smoothing before gradients are taken, in thumbnail pixels: a flat place is flat
as far around as registration may be wrong."""

DARKEST_EXPOSED_LEVEL, BRIGHTEST_EXPOSED_LEVEL = 0.04, 0.97
"""Grey levels beyond which a place counts as clipped: of a mean over many pixels, some are clipped before it is."""

THUMBNAIL_CLIP_MARGIN_PX = 2
"""Places this close to a clipped one are not used, in thumbnail pixels: twice the smoothing."""

# Registration of thumbnails (ospc.correspondence.thumbnail_registration)

MIN_OVERLAP = 0.25
"""Smallest share of the places of one view that must be found in the other. Where less is, most of it is found by
chance: it is alike in grey level whatever the exposures. Such pairs were wrong by a factor of two on average, those
above by half a per cent."""

THUMBNAIL_MARGIN_PX = 2
"""Places nearer to the border of the second thumbnail are not used, in its pixels."""

THUMBNAIL_SEARCH_STRIDE_PX = 6
"""Distance between the patches of 8 pixels that are searched for, in thumbnail pixels: OpenCV's 4 take twice the
time, and ln M of a grey bin differs by 0.0001 only."""

MAX_THUMBNAIL_ERROR_PX = 1.0
"""Largest distance between a place and where registration there and back ends, in thumbnail pixels."""

MIN_REGISTERED_SIDE_PX = 32
"""Dense inverse search needs a few patches along each side; smaller images are taken to stand still."""

MIN_EXPOSED_SHARE = 0.99
"""Interpolated share of exposed pixels from which a place counts as exposed: all its neighbours are, but for
rounding."""

# Equal brightness before registration (ospc.correspondence.exposure_normalizer)

DISPLAY_GAMMA = 2.2
"""Exponent of the scale on which images are registered, that of displays: noise and contrast are similar in dark and
bright parts."""

DARKEST_COMPARED_GREY, BRIGHTEST_COMPARED_GREY = 8.0, 247.0
"""Grey levels beyond which a quantile may be clipped, of 255."""

MAX_LOG_RATIO_DISAGREEMENT = 0.4
"""Largest difference, in ln, between the exposure ratio stated and that in the images at which the former is taken.
With the response still unknown the images are wrong by as much; once it is known, by some hundredths."""

CLEAR_LOG_RATIO_AGREEMENT = 0.2
"""Largest difference, in ln, between the exposure ratio stated and that of the quantiles of grey at which the former
is taken without a closer look. Quantiles are wrong by less where most of a view is shared."""

MIN_SHARED_PLACES = 0.15
"""Share of the places of the thumbnails that two frames must have in common for their brightness to be compared place
by place; where less is, the quantiles of their grey levels are compared."""

MAX_LOG_RATIO_SPREAD = 0.15
"""Standard deviation, in ln, of the ratios of single places up to which their median is relied on."""

MIN_KEPT_BRIGHTNESS = 0.5
"""Least brightness of the middle of the longer exposed image, on a display's scale, as a share of what it is in the
frame. Of responses from black to white, the logarithm of 1 to 51 keeps 0.77; where grey levels end at 128, quick fits
kept a thousandth and less, and moving cameras seemed to stand still."""

MIN_IRRADIANCE = 1e-6
"""Lowest irradiance whose logarithm is taken: below that of the first grey level of any camera."""

# Dense registration (ospc.correspondence.registration)

SECOND_SEARCH_STEPS, SECOND_SEARCH_STRIDE_PX = 8, 5
"""Steps of descent per patch, and distance between patches in pixels, in the search for what a homography leaves: a
third of OpenCV's steps on a coarser lattice. The search before it needs all of them: with fewer, half of what a pair
tells of the vignette was lost."""

REFINEMENT_ITERATIONS, REFINEMENT_GRADIENT_WEIGHT = 5, 20.0
"""Iterations of the variational refinement, OpenCV's for this quality, and the weight in it of the constancy of the
gradient against smoothness of the displacements: twice OpenCV's default, since nothing else is weighed."""

HOMOGRAPHY_SPACING_PX, HOMOGRAPHY_MIN_ROWS = 16, 12
"""Distance in pixels between the places to whose coarse displacements a homography is fitted, and fewest rows and
columns of them: they are closer in small images. There are some hundreds of them."""

HOMOGRAPHY_INLIER_PX = 2.0
"""Largest error of a coarse displacement that supports the homography, in pixels: as far as the search after it
easily reaches."""

HOMOGRAPHY_MIN_INLIERS = 16
"""Fewest places that must support a homography: one through four places fits them whatever their errors."""

JACOBIAN_CELL_PX = 32
"""Side of the squares within which displacements are averaged before their slopes are taken, in pixels of the small
images. Ratios of areas from squares of 8 pixels were off by 3 %, enough for films that only move sideways to get a
vignette with a centre of its own."""

# Keyframe selection (ospc.correspondence.keyframe_selection)

AGE_CLASSES = 26
"""Classes of age in frames, two for each doubling: up to 5800 frames."""

PRIOR_OVERLAP, PRIOR_RADIAL_MOTION = 0.8, 0.01
"""Overlap, and radial motion in half diagonals, expected of the youngest class before any comparison. Each further
class is expected to overlap like the one before, and to have moved in proportion to its age."""

MAX_PRIOR_RADIAL_MOTION = 0.3
"""Largest radial motion expected, in half diagonals."""

AGE_CLASS_RATIO = 2.0**0.5
"""Age of a class over that of the one before."""

PRIOR_COMPARISONS = 1.5
"""Weight of what is expected before any comparison, in comparisons: the first real ones soon outweigh it."""

MAX_COMPARISONS = 100
"""Comparisons that count: the camera may move faster or slower than so many ago."""

RESPONSE_TURN = 3
"""Every so many selections serve the response, of which a pair tells more than of the vignette."""

EXPOSURE_CHANGE_WEIGHT = 0.01
"""Weight of a squared change of exposure where the vignette is the aim: it breaks ties between equal motions."""

MIN_INFORMATION = 1e-6
"""Information assumed of a comparison without change of exposure or motion, so that overlap decides between them."""

OVERLAP_POWER = 1.5
"""Information grows with this power of the overlap, faster than the number of shared places: registration is better,
too, where more overlaps."""

OLDEST_AGE_FACTOR = 1.5
"""Age of an imagined keyframe before the oldest, over that of the oldest: it decides when the oldest is dropped."""

# Sampling of flat places (ospc.correspondence.flat_sampling)

SAMPLING_GREY_CELLS, SAMPLING_RADIUS_CELLS = 8, 4
"""Ranges of the root of grey level and of radius from which scene points are taken in turn where there are too many:
otherwise the sky or a wall would make up most of them."""

MIN_MOTION_PLACES = 100
"""Fewest places found again from which the motion is measured."""

STRUCTURE_QUANTILE = 0.8
"""Quantile of the gradient above which a place shows motion: registration fills in flat ones from their
surroundings."""

MOTION_PARTS_PER_SIDE = 4
"""Parts of the image, along each side, within which displacements are averaged as vectors, so that noise cancels."""

MIN_PART_PLACES = 8
"""Fewest places of such a part: with fewer, noise does not cancel, and a camera that stands still seems to move."""

# Equal smoothing of both views (ospc.correspondence.equal_smoothing)

NODE_STEP_PX = 2
"""Distance of the nodes around a place from whose values a wider smoothing follows, in reduced pixels: for the
usual stretches, up to 1.25, about that at which three nodes stand for a Gaussian (Gauss-Hermite)."""

PIXEL_VARIANCE = 1 / 12
"""Variance of a place within its pixel, which averages too, in square pixels."""

MAX_STRETCH = 1.6
"""Largest stretch between two views, and the inverse of the smallest: about that from the centre to the corner of a
view of 75°. More is an error of the registration at an edge in depth."""

# Noise of single pixels (ospc.correspondence.noise_estimation)

NOISE_BINS = 16
"""Equal ranges of grey level in which noise is measured: it changes little within one, and enough blocks fall into
it."""

NOISE_BLOCK_PX = 8
"""Side of a block in pixels: small enough to fit between structures, and its 64 values give a variance to a fifth."""

MIN_BAND_SPACING_ROWS, MAX_BANDS = 24, 20
"""Fewest rows from one band of blocks to the next, and most bands: a third of an image of 640×480 is enough."""

NOISE_QUANTILE = 0.1
"""Quantile of the blocks' variances that is taken for noise alone: hardly any image has structure in more than nine
tenths of its blocks."""

NOISE_QUANTILE_RATIO = 0.627
"""A tenth of blocks of pure noise have a variance below this share of the true one."""

MIN_NOISE_BLOCKS = 40
"""Fewest blocks of a grey range in a frame: a tenth of them are then four."""

NOISE_FRAMES = 64
"""Latest frames whose variances are kept; the median over them hardly changes with more."""

MIN_END_DISTANCE_SIGMAS = 4
"""Distance from black and white, in standard deviations of the noise, at which a range shows all of its noise.
Nearer, only blocks with little noise pass as exposed."""

QUANTISATION_VARIANCE = 1 / 12
"""Variance of rounding to whole grey values: the least noise of any image."""

ASSUMED_NOISE_SIGMA = 0.5 / 255
"""Standard deviation assumed where nothing was measured: half an 8-bit grey level."""

# A stationary camera (ospc.correspondence.static_series)

SERIES_BRIGHTNESS_CELLS = 64
"""Equal ranges of ln brightness from which pixels are taken in turn: dark and bright ones are rare but most
informative."""

# The image circle of a fisheye (ospc.correspondence.image_circle)

MIN_CIRCLE_FRAMES = 8
"""Fewest frames looked at before a dark place counts as surround: in a single frame the scene itself may be dark."""

LIT_QUANTILE = 0.9
MIN_LIT_GREY = 60
"""Grey level, of 255, that the brightest tenth of the image must reach: in dark recordings all places look alike."""

MAX_SURROUND_SHARE = 0.1
"""Grey level of the surround over that of this brightest tenth: a little stray light reaches it. A higher limit would
take dark parts of the scene for it."""

MIN_SURROUND_AREA = 0.01
"""Smallest part of the image that is taken for a surround: less is strong vignetting in the very corners."""

MIN_SURROUND_CORNERS = 3
"""Corners that the surround must reach: an image circle may be off centre and leave one, a dark wall reaches two."""

SURROUND_MARGIN_PX = 3
"""Widening of the surround, in small pixels: the edge of the circle is blurred, and light falls off steeply there."""

WHOLE_IMAGE_RADIUS = 0.97
"""An image of which something is usable so far out counts as usable up to its corners."""

# Statistics of grey values (ospc.correspondence.pixel_statistics)

MAX_COUNTED_FRAMES = 1024
"""Frames whose own shares are kept; beyond, every second is dropped, which bounds the memory of endless runs."""

MAX_GREY_RANGES = 100
"""Latest changes of black and white that are remembered: usually there is one, in the first frames."""

COVERAGE_GREY_CELLS = 32
"""Equal ranges of grey level whose coverage is reported: as many as the response has intervals between knots."""

COVERAGE_RADIUS_CELLS = 10
"""Equal ranges of radius, from the centre to the corner, whose coverage is reported."""

COUNTED_STRIDE = 2
"""One in so many rows and columns is counted: a quarter of the pixels has the same shares, in a quarter of the
time."""

COMPARED_COLUMNS_PX, LEAST_ROW_VARIANCE = 8, 3e-7
"""Columns whose mean is compared from row to row, and what is added to the variance of the differences, of white
squared: what quantisation to 8 bit leaves."""

INTERLACED_QUANTILE, MIN_INTERLACED_ALTERNATION = 0.75, 0.65
"""How much rows alternate in interlaced images, and the quantile over frames that is judged: where nothing moves,
they do not. In 45 recordings of all kinds, compression and noise of rows or pixels included, it was 0.35 at most.
With every other row from the next frame, it was 0.78 or more. Doubled or interpolated rows have 0 or less."""

MIN_COVERED_SHARE = 0.001
"""Share of all pixels from which a range of grey is covered: less is noise, lettering, or a reflection."""

BLACK_PLACE_LEVEL = 0.045
"""Grey level of a thumbnail below which a place is black: stray light, noise and a black level of a few grey values
stay below it."""

MIN_MEDIAN_LEVEL = 0.15
"""Median over the places of their largest grey level, below which nothing is said about black ones: the scene is
dark."""

MIN_BORDER_SHARE = 0.002
"""Smallest part of the image that is reported as a black surround, some forty places of a thumbnail: less is a dark
object at the edge."""

RECTANGLE_FILL = 0.95
"""Share of its bounding box above which the lit part is a rectangle in a black border; a disc fills π/4 of it."""

MIN_PILE_SHARE = 0.005
"""Share of the pixels at an extreme grey value from which values are piled up there: noise would spread them."""

CLIPPING_MARGIN = 0.02
"""Distance of that value from the end of the scale, as a share of it: nearer, it is ordinary clipping."""

WHITE_NEIGHBOURHOOD = 2 / 255
"""Distance below the highest grey value within which all others together must have fewer pixels, for values to be
piled up there: of few grey values, each has a large share. White had four times as many and more in 20 films."""

HIGHEST_BLACK = LOWEST_WHITE = 0.2
"""Limits of black and of white. Wherever white was, from grey value 76 to 128, it had 0.009 of all pixels and more;
in 39 dark films that were not clipped, the highest grey value had less than 0.0005."""

MIN_MISSING_LEVELS_SHARE = 0.05
"""Share of missing grey values between the extremes from which they are reported: a few rare ones miss by chance."""

MIN_COMB_RANGE = 32
"""Least distance of the extremes, in grey values, from which missing ones are counted: a dark image has few
values."""

# Observations (ospc.observations)

CLIPPED_MARGIN = 1 / 255
"""Distance up to which a grey level counts as clipped at a black or white that is not the end of the scale: one grey
value of 8 bits."""

POSITION_TOLERANCE = 0.02
"""Share of the half diagonal by which a place may lie beyond the corner: half a pixel and rounding."""
