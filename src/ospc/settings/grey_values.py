"""Constants of the statistics of grey values: their meaning, unit and the reason for their value."""

# The image circle of a fisheye, and overlays (ospc.correspondence.scene_area)

MIN_CIRCLE_FRAMES = 8
"""Minimum number of frames before a dark point counts as surround: in a single frame the scene itself may be dark."""
MIN_CIRCLE_FILL = 0.92
"""Least share of the smallest circle around the usable part, within the image, that is usable if it is an image
circle: 0.947 to 1 for 96 circles with hard and soft edges and noise, decentred by up to 0.2 half diagonals, 0.88 for
a trapezoid, and 0.78 for an image with bars on two sides."""
LIT_QUANTILE = 0.9
MIN_LIT_8_BIT = 60
"""Grey level, of 255, that the brightest tenth of the image must reach: in the dark, scene and surround look
similar."""
MAX_SURROUND_SHARE = 0.1
"""Grey level of the surround relative to the brightest tenth: a little stray light reaches it. A higher limit would
include dark parts of the scene."""
MIN_LIT_PX = 24
"""Minimum number of connected small pixels that receive light: in the surround, the brightest of many noisy frames
has specks of one to three pixels. They made the usable radius of an endoscope 0.97 half diagonals instead of 0.62."""
MIN_SURROUND_AREA = 0.001
"""Smallest share of the image that counts as a surround: that outside a circle of 0.98 half diagonals. With 0.01, V
was extrapolated to 0.65 at the black corners of circles of 0.94 and 0.96, with a standard deviation of 0.01."""
MIN_SURROUND_CORNERS = 3
"""Minimum number of corners in the surround: a decentred image circle may miss one, a dark wall covers two."""
SURROUND_MARGIN_PX = 3
"""Widening of the surround, in small pixels: the edge of the circle is blurred, and light falls off steeply there."""
SOFT_SURROUND_MARGIN_PX = 6
"""The same beside a soft edge, where the scene is too dark to be registered, and where the fall of the light lies
still. With 3 px, the radial motion between registered frames of four simulated full-circle fisheyes was 0.67 to 1
times that with 6 px. 9 px helped as much, but covered too much of small images."""
MIN_COUNTED_PAIRS = 8
"""Minimum number of pairs of frames in which the motion of the view would have changed what a pixel shows. With 16, a
watermark was not found in a video whose view hardly moves, but about three of five false notes in 16 simulated zooms
and drives did not appear."""
OVERLAY_LINE_PX = 5
"""Side of the square whose mean is compared with its central pixel, in small pixels: wider than a blurred edge, and
narrow enough that vignetting, dust and blurred shadows are flat."""
MIN_FINE_STRUCTURE_8_BIT, MAX_FINE_STRUCTURE_8_BIT = 2.0, 8.0
"""Minimum deviation of a line of an overlay from its surroundings, in grey levels of 255: more than noise and fixed
patterns. Larger deviations than the maximum count as the maximum, so that no single view decides."""
MIN_OVERLAY_AGREEMENT = 0.8
"""Minimum agreement of fine structure between views, from 0 to 1, for it to be fixed to the camera."""
MIN_OVERLAY_PX = 24
"""Minimum number of connected small pixels of a line: fewer agree by chance, or are a group of defective pixels."""
MAX_ENCLOSED_SHARE = 0.05
"""Maximum share of the image that lines enclose and that counts as covered: the inside of a letter or a box. The
horizon also stays where it is if the camera only turns, but separates larger parts."""
MAX_OVERLAY_SHARE = 0.4
"""Maximum share of the image that overlays cover: if it is exceeded, the scene itself hardly changes."""
MIN_SHARP_EDGE_RATIO = 0.9
"""Minimum typical grey level in the margin of a surround, relative to that next to it, for its edge to be sharp: 0.96
to 1 beside six hard discs, 0.45 to 0.8 beside six fisheye circles with a soft edge."""
MIN_EDGE_RATIO = 3.0
"""Minimum typical grey level next to the margin of a surround, relative to that of the surround. Inside the edge of
an image circle, it is ten times as bright, or still five times where V falls to 0.3 and stray light reaches 0.06. In
dark corners of wide lenses, where V falls smoothly to 0.08 or 0.18, it is 1.5 to 2.3 times as bright."""
WHOLE_IMAGE_RADIUS = 0.97
"""If a usable part that is no circle reaches this value, the image counts as usable up to its corners."""

# Statistics of grey values (ospc.correspondence.pixel_statistics)

MAX_COUNTED_FRAMES = 1024
"""Maximum number of frames whose statistics are kept individually. Beyond it, every second one is dropped, also of
those that follow, which bounds the memory of endless runs."""
MAX_GREY_RANGES = 100
"""Number of latest changes of black and white that are kept: usually there is one, in the first frames."""
COVERAGE_GREY_CELLS = 32
"""Number of equal grey ranges whose coverage is reported: as many as the fit resolves."""
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
MOST_CLIPPED_SHARE = 0.9
"""Share of black or saturated pixels above which no recording like it can be used, so that nothing else needs to be
advised. Chosen by hand."""
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
if only a few grey values occur, each has a large share. White had at least four times as many in 20 videos."""
HIGHEST_BLACK = LOWEST_WHITE = 0.2
"""Upper limit of black and lower limit of white. White between grey values 76 and 128 had at least 0.009 of all
pixels; in 39 dark videos without clipping, the highest grey value had less than 0.0005."""
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
"""If all frames with this peak have about the same exposure, frames with exposures shorter by up to this in ln
decide. Among as many of their brightest pixels as the peak has, the grey levels at these quantiles must be at least
this many of the 32 ranges of grey apart: 2 or 3 in a real video, at most 1 for a uniform object."""
MIN_MISSING_LEVELS_SHARE = 0.05
"""Share of missing grey values between the extremes above which they are reported: a few rare ones are missing by
chance."""
MIN_COMB_RANGE = 32
"""Minimum distance between the extremes, in grey values, for counting missing ones: a dark image has few values."""
