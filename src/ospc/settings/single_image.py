"""Constants of calibration from single images: their meaning, unit and the reason for their value."""

import numpy as np

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

# The guess (ospc.unknown_exposures.single_image.fallback)

MAX_SINGLE_IMAGES = 8
"""Number of evenly spaced images of a recording to use: more would show the same surfaces again."""
SHAPE_SIGMA = 0.4
"""Relative standard deviation of ln g(M)/g(½), like that of an exponent: 78 % of the grey levels of 201 measured
responses are then within one standard deviation of the typical one, and 96 % within two."""
MIN_SHAPE_SIGMA = 0.08
"""Standard deviation of ln g(M)/g(½) close to ½, where curves differ by more than an exponent."""
CORNER_SIGMA = 0.2
"""Standard deviation of V in the corners; it grows linearly with the radius. It is 0.11 on simulated photographs with
typical lenses, but wide-angle lenses lose more."""
OWN_VIGNETTE_WEIGHT = 0.2
"""Weight of the estimate relative to a typical vignette, which minimises the errors on simulated photographs."""
TYPICAL_VIGNETTE = (-0.2, -0.1, -0.05)
"""v₁, v₂, v₃ of a typical vignette."""

DARKEST_PIXEL_8_BIT, BRIGHTEST_PIXEL_8_BIT = 2, 250
"""Grey levels, of 255, outside which a pixel may be clipped."""
MIN_SINGLE_IMAGE_SIDE_PX = 32
"""Smallest width and height of an image; smaller ones contain neither edges nor rings."""
