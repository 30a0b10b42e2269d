"""Constants of preprocessing and registration: their meaning, unit and the reason for their value."""

import numpy as np

# Preprocessing (ospc.correspondence.preprocessing)

FLATNESS_PX = 2.5
"""Standard deviation of the smoothing before gradients are taken, in reduced pixels: the distance over which the
image has to be flat."""
REGISTRATION_SIDE_PX = 400
"""Frames are registered at the reduced size or its first half, quarter, … that is at most this long, unless it is
narrower than :data:`MIN_REGISTERED_SIDE_PX`."""
BLACK_MARGIN_PX = 3
MAX_BLACK_SHARE = 0.25
"""Half the side of the square in which black pixels are counted, and their largest share at an exposed point; none
may be masked. In the dark, noise alone makes some pixels black, and its effect on the mean is corrected; a larger
share has other causes."""
WHITE_MARGIN_PX = 5
MAX_WHITE_SHARE = 0.02
"""The same for white pixels. Noise hardly clips there, but the peaks of texture do: with a quarter of white pixels
and 3 px, ln g at grey 225 to 240 was off by up to 0.02."""
COMPARED_QUANTILES = np.linspace(0.05, 0.95, 19)
"""Quantiles of grey level at which the brightness of two images is compared; noise and clipping affect the ends."""
SURROUND_SIGMAS = (0.1, 0.25)
"""Standard deviations of the distance over which light is scattered nearby and widely, in longer sides of the image:
between that of bloom, a few pixels, and veiling glare, the whole image. Local tone mapping acts over distances
similar to the first. In images of 120×480 pixels, a tenth of the width covered so little that a clean recording
seemed to be tone mapped."""
SURROUND_SIGMA_PX = 6.4
"""The same in pixels of the coarse images in which surroundings are averaged: the means are smooth over six of
them."""
MIN_FLAT_AREA_RATIO = 2.0
"""Minimum area over which the image must be flat, relative to the area over which grey levels are averaged:
registration may be off by a pixel, and the image must be flat there, too."""
IMPULSE_SURROUND_PX = 5
"""Side of the square around a pixel over which the usual deviation is taken: the largest for which OpenCV has a
median of 16-bit images."""
IMPULSE_CONTRAST, IMPULSE_DEVIATIONS = 0.1, 6.0
"""A pixel that differs from the median of its surroundings by more than this share of white, plus this multiple of
the usual deviation around it, may be a defect (a dead pixel, a transmission error); averages then use the median
instead. Registration uses the unmodified images: with chart lines treated as defects, a stationary camera seemed to
move."""
IMPULSE_LIKENESS = 0.5
"""Share of a pixel's deviation beyond which a neighbour deviates in the same way. A defect has at most one such
neighbour. Fine lines have more: replacing them, which happens mostly in the brighter of two frames, made brick walls
0.15 % too dark in it, and ln g off by 0.4 % of ln k. One pixel in 3000 is replaced there, instead of one in 120."""
MIN_SMOOTHING_VARIANCE = 0.04
"""Minimum variance of a smoothing, in square pixels: narrower ones have no effect."""

# Thumbnails (ospc.correspondence.thumbnail)

THUMBNAIL_SIDE_PX = 160
"""Longest side of a thumbnail in pixels: 19 000 points, by which neighbouring frames are compared in a
millisecond."""
LEAST_THUMBNAIL_PIXELS = 160 * 90
"""Minimum number of pixels of a thumbnail, unless the image has fewer, even if a side is then longer: with 24 rows of
a panorama, exact exposures seemed to be stale."""
THUMBNAIL_SMOOTHING_PX = 1.0
"""Standard deviation of the smoothing of grey levels, in thumbnail pixels: about the registration error."""
THUMBNAIL_GRADIENT_SMOOTHING_PX = 1.2
"""Standard deviation of the additional smoothing before gradients are taken, in thumbnail pixels: a flat point must
be flat within the registration error."""
DARKEST_EXPOSED_MEAN, BRIGHTEST_EXPOSED_MEAN = 0.04, 0.97
"""Grey levels beyond which the mean of several pixels counts as clipped: some of them are clipped before the mean is.
Single pixels have the limits ``DARKEST_EXPOSED`` and ``BRIGHTEST_EXPOSED`` of :mod:`ospc.photometry.noise`."""
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
MAX_REMAPPED_ROWS = 2**15 - 2
"""Largest number of points in one column that OpenCV interpolates: it counts rows in 16 bits."""
MAX_THUMBNAIL_ERROR_PX = 1.0
"""Largest forward-backward registration error of a point, in thumbnail pixels."""
MIN_REGISTERED_SIDE_PX = 32
"""Dense inverse search needs a few patches along each side: OpenCV's ends the process with a segmentation fault on
images that are wide and lower than this. Frames are not reduced any further; smaller thumbnails are treated as
stationary."""
MIN_EXPOSED_SHARE = 0.99
"""Interpolated share of exposed pixels above which a point is exposed: all its neighbours are, up to rounding."""

# Equal brightness before registration (ospc.correspondence.exposure_normalizer)

DISPLAY_GAMMA = 2.2
"""Exponent of the scale on which images are registered, that of displays: noise and contrast vary little with
grey."""
DARKEST_QUANTILE_8_BIT, BRIGHTEST_QUANTILE_8_BIT = 8.0, 247.0
"""Grey levels, of 255, beyond which a quantile of the grey levels of a frame may be clipped."""
MAX_LOG_RATIO_DISAGREEMENT = 0.4
"""Largest difference, in ln, between the stated exposure ratio and that measured in the images for the stated one to
be used. The measured one has errors of this size while the response is unknown, and of a few hundredths
afterwards."""
CLEAR_LOG_RATIO_AGREEMENT = 0.2
"""Largest difference, in ln, between the stated exposure ratio and that of the grey quantiles for the stated one to
be used without further checks. Quantiles have smaller errors if the views overlap for the most part."""
MAX_TRUSTED_LOG_RATIO = 1.2
"""Stated exposure ratio, in ln, from which the images are checked even if earlier ones confirmed the exposures: their
unit may have changed. Larger ratios are rare, because most points are then clipped in one of the frames."""
MIN_SHARED_PLACES = 0.15
"""Share of the thumbnail points that two frames must have in common for their brightness to be compared point by
point; with fewer, the quantiles of their grey levels are compared."""
MAX_LOG_RATIO_SPREAD = 0.15
"""Standard deviation, in ln, of the ratios of individual points up to which their median is trusted."""
MAX_LOG_DISPLAY = 5.0
"""Largest ln of a grey level on the display scale, relative to white: beyond all corrections of the vignette."""
MIN_KEPT_BRIGHTNESS = 0.5
"""Minimum brightness of the middle grey level of the longer exposure after normalisation, on the display scale,
relative to that in the frame. Of responses from black to white, the logarithm of 1 to 51 keeps 0.77; with grey levels
ending at 128, quick fits kept a thousandth or less, and moving cameras seemed stationary."""

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
rows and columns of points, which are closer together if the image, or its part that shows the scene, is small. There
are several hundred of them."""
HOMOGRAPHY_INLIER_PX = 2.0
"""Largest error, in pixels, of a coarse displacement that supports the homography or the curved motion: the next
search easily corrects it."""
HOMOGRAPHY_MIN_INLIERS = 16
"""Fewest points that must support a motion: a homography through four points fits them whatever their errors."""
CURVED_MOTION_ORDER = 3
"""Order of the polynomials that describe how the image of a fisheye moves. In turns of simulated full-circle fisheyes
by 20 to 30 pixels, a homography explained a fifth to a third of the points, second order a fifth less than third,
and third order as many as were found forward and back."""
CURVED_MOTION_MIN_GAIN = 1.3
"""Number of points that a curved motion explains, relative to a homography, from which it is used: up to three times
as many with a fisheye. With a masked ordinary lens, it explains a little more where the scene has depth, but the
median error of irradiance ratios rose from 0.10 to 0.13 % and from 0.06 to 0.10 % in two recordings."""
CURVED_MOTION_STEPS, CURVED_MOTION_DISTRUST = 15, 0.75
"""Iterations of its robust fit, and the power by which the weight of an equation falls with 1 + (error / largest
error of a supporting point)²: 0.75 is that of Student's t distribution with half a degree of freedom."""
MAX_DISPLACEMENT_SPREAD_PX = 1.0
"""Largest standard deviation, in pixels of the small images, of the displacements around a point, after those of the
homography are removed. Of simulated points with a larger one, 15 to 50 % were wrong by more than a pixel, of the
others 1 to 4 %."""
DISPLACEMENT_SPREAD_SIGMA_PX, DISPLACEMENT_CELL_PX = 8.0, 4
"""Standard deviation of the Gaussian weights around a point, in pixels of the small images: the size of a patch of
the search. For speed, displacements are first averaged over squares with sides of this many pixels."""
JACOBIAN_CELL_PX = 32
"""Side of the squares over which displacements are averaged before they are differentiated, in pixels of the small
images. With squares of 8 pixels, area ratios were off by 3 %, enough to shift the vignette centre in videos that only
move sideways."""
