"""Constants of calibration from single images: their meaning, unit and the reason for their value."""

from __future__ import annotations

import numpy as np

# The response from edges (ospc.unknown_exposures.single_image.edges)

EDGE_WINDOW_PX = 15
"""Side of a window, as published."""

EDGE_BLEND_PX = 2
"""Distance from the edge, in pixels, within which pixels cover both regions."""

EDGE_SPACING_PX = 8
"""Side of the cells that contain at most one window each, centred on the pixel with the strongest gradient."""

CANNY_THRESHOLDS = (40, 100)
"""Thresholds of the edge detector, in grey levels."""

MAX_REGION_SPREAD, MIN_EDGE_CONTRAST = 4.0, 20.0
"""Largest standard deviation within a region and smallest difference between the regions, in grey levels of each
channel: the error of the means must be small compared with the curvature of the response in between."""

MIN_REGION_PIXELS, MIN_EDGE_PIXELS = 20, 8
"""Fewest pixels of a region and an edge; with fewer, their means are noise."""

BETWEEN_MARGIN = 0.03
"""Margin between an edge pixel and both regions, relative to their difference: pixels within it cover only one
region."""

UNCLIPPED_REGION_8_BIT = (3, 252)
"""Grey levels, of 255, outside which a region may be clipped."""

MAX_EDGE_WINDOWS = 1500
"""Most windows of an image, strongest edges first; more take time and do not improve the curve."""

MIN_PATCHES = 5
"""Fewest patches for estimating a curve."""

COLOUR_PRIOR_WEIGHT = 3 * 0.001
"""λ of edge colours, for three channels."""

MIN_SQUARED_LENGTH = 1e-12
"""Lower bound of the squared length of a line, against division by zero."""

# The prior of responses (ospc.unknown_exposures.single_image.response_prior)

PRIOR_LEVELS = 256
"""Grey levels at which curves are tabulated."""

PRIOR_COMPONENTS = 5
"""Number of components of g, as published."""

PRIOR_VARIANCE = 1.05
"""Variance of each coefficient: 1 for the learned curves, and a little more for curves between them."""

MIN_PRIOR_SLOPE = 1e-3
"""Smallest slope of g, so that it has an inverse."""

EDGE_TOLERANCE = 1e-6
"""Gradient of the cost at which the minimisation ends: smaller ones do not change any grey level."""

DECREASE_WEIGHT = 100.0
"""Weight of decreasing parts of a curve (the sum of all decreases in full scale) relative to −ln p: a response must
not decrease."""

# The vignette of single images (ospc.unknown_exposures.single_image.zheng_2008)

RING_SPARSITY, RING_SMOOTHNESS, RING_ROUNDS = 0.6, 0.3, 4
"""α, λ, and number of reweighting iterations."""

RING_REDUCTION, RING_OFFSET = 4, 1 / 255
"""Factor by which images are reduced, and offset added to irradiances to keep their logarithms finite."""

MIN_REDUCED_SIDE_PX = 60
"""Shorter side in pixels below which an image is not reduced further, because rings need pixels."""

RING_RIDGE = 1e-9
"""Regularisation of B towards zero, which makes the solution unique."""

MIN_RING_RESIDUAL = 1e-9
"""Added to s₁, because it is raised to a negative power."""

FITTED_RADII = np.linspace(0, 1, 61)
"""Radii at which a polynomial is fitted to V."""

MIN_RING_VIGNETTE = 0.05
"""Lower bound of V: no usable lens attenuates more."""

# Both, blended with typical curves (ospc.unknown_exposures.single_image.fallback)

MAX_SINGLE_IMAGES = 8
"""Number of evenly spaced images of a recording to use: more would show the same surfaces again."""

SHAPE_SIGMA = 0.4
"""Relative standard deviation of ln g(M)/g(½), like that of an exponent, on simulated photographs."""

MIN_SHAPE_SIGMA = 0.08
"""Standard deviation of ln g(M)/g(½) close to ½, where curves differ by more than an exponent."""

CORNER_SIGMA = 0.2
"""Standard deviation of V in the corners; it grows linearly with the radius. It is 0.11 on simulated photographs with
typical lenses, but wide-angle lenses lose more."""

OWN_RESPONSE_WEIGHT, OWN_VIGNETTE_WEIGHT = 0.5, 0.2
"""Weights of the estimates relative to typical curves, which minimise the errors on simulated photographs."""

TYPICAL_VIGNETTE = (-0.2, -0.1, -0.05)
"""v₁, v₂, v₃ of a typical vignette."""

DARKEST_PIXEL_8_BIT, BRIGHTEST_PIXEL_8_BIT = 2, 250
"""Grey levels, of 255, outside which a pixel may be clipped."""

MIN_SINGLE_IMAGE_SIDE_PX = 32
"""Smallest width and height of an image; smaller ones contain neither edges nor rings."""
