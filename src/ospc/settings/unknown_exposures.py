"""Constants of unknown exposures and of single images: their meaning, unit and the reason for their value."""

import numpy as np

# Recovery of exposures (ospc.unknown_exposures.recovery)

EXPONENT_SIGMA = 0.34
"""Standard deviation of ln γ between the mean response used here and the 201 measured ones of the database of
response functions (Grossberg and Nayar 2004); the mean of ln γ is 0.05."""
MAX_RECOVERED_FRAMES = 1500
"""Most frames, from the first, whose exposures are estimated: memory and time grow with their number."""
EXPONENT_LEVELS = np.linspace(0.1, 0.9, 81)
"""Grey levels at which a response is compared with the mean response, without the ends, which suffer from noise and
saturation."""

# Joint estimation (ospc.unknown_exposures.joint_estimation)

JOINT_HUBER = 0.015
"""Residual, relative to full scale, above which the Huber loss is linear: four 8-bit levels, a few times the
noise."""
MIN_JOINT_OBSERVATIONS = 200
"""Fewest observations: a few for each of about ten parameters and for the radiances."""
MIN_JOINT_VIGNETTE, MAX_JOINT_LOG = 0.05, 12.0
"""Smallest V and largest |ln| of the irradiance, far beyond any camera, to keep the optimisation finite."""
JOINT_TOLERANCE, JOINT_ALTERNATIONS = 1e-5, 60
"""Relative decrease of the cost at which the alternation ends, because the data do not determine smaller changes, and
most alternations."""
RESPONSE_COMPONENTS = 4
"""Number of components of the model of responses, of at most five that the published one has."""
RESPONSE_SAMPLES = 1024
"""Number of irradiances at which a model of responses is tabulated, as in the published tables."""
MIN_START_IRRADIANCE = 1e-4
"""Smallest irradiance whose logarithm is used for the initial exposures: darker samples are noise."""
MAX_DAMPED_ATTEMPTS, MAX_JOINT_STEP = 6, 0.5
"""Most attempts with increased damping, and largest change of ln e or ln L in a step, to keep the linearisation
valid."""
START_DAMPING, MIN_DAMPING = 1e-3, 1e-7
DAMPING_UP, DAMPING_DOWN = 8, 4
"""Levenberg-Marquardt damping relative to the diagonal: initial value, lower bound, factor after a failed step, and
divisor after a successful one."""
SOLVER_TOLERANCE = 1e-8
"""Relative accuracy of the linear system for the initial exposures, far below their errors."""
MAX_SOLVER_STEPS = 400
"""Most steps of its solver, which propagates exposures along chains of tracks by about one frame per step."""

# Tracks (ospc.unknown_exposures.tracking)

OBSERVED_OFFSETS_PX = np.array([(0, 0), (3, 0), (-3, 0), (0, 3), (0, -3)], dtype=np.float32)
"""Offsets in pixels of the scene points that are observed around each feature: they have other grey levels than the
feature, but are still within the tracked window."""
MAX_GAIN_ROUNDS, MIN_GAIN_CHANGE = 2, 0.02
"""Most alternations of tracking and gain, and change of ln gain at which they end: tracking tolerates a smaller
error."""
TRACKED_FEATURES = 250
"""Number of features tracked at a time; the published program tracks more, and takes longer."""
TRACKING_WINDOW_PX, PYRAMID_LEVELS = 21, 4
"""Side of the tracking window, and levels of the pyramid above the image, for motion up to about 100 pixels."""
MAX_TRACK_RETURN_PX = 0.7
"""Largest forward-backward error of a track in pixels: tracks that do not return are on another feature."""
TRACKING_MARGIN_PX = 6
"""Smallest distance of a feature from the border and from masked pixels, in pixels, so that the points around it and
their gradients lie inside."""
REFILL_SHARE = 0.7
"""Share of the features below which new ones are detected: detection takes time, and long tracks are most
informative."""
FEATURE_QUALITY, FEATURE_SPACING_PX = 0.005, 14
"""Corner detection: smallest strength relative to the strongest corner, low to include weak texture, and smallest
distance between corners in pixels, so that they cover the image."""
OCCUPIED_PX = 12
"""Radius in pixels around a feature within which no new one is detected: it would be the same feature."""
TRACKED_SMOOTHING_PX = 0.8
"""Standard deviation of the smoothing of sampled grey levels: less noise, and hardly any blur."""
DARKEST_TRACKED_8_BIT, BRIGHTEST_TRACKED_8_BIT = 1.5, 254.0
"""Grey levels, of 255, between which a sample is well exposed; the upper limit applies to its brightest neighbour."""
GAIN_SIDE_PX = 7
"""Side of the squares around features whose mean brightness determines the gain: averaging reduces the effects of
noise and motion blur."""
DARKEST_GAIN_8_BIT, BRIGHTEST_GAIN_8_BIT = 3, 245
"""Grey levels, of 255, between which these means are used; otherwise some of their pixels are clipped."""
MEDIAN_STEP_PX = 4
"""Row and column step at which the median of an image is computed."""
TRACKED_GRADIENT_SCALE = 12.0
"""Gradient, in grey levels per pixel, at which a sample has half its weight: there, displacement errors dominate."""

# The model of responses (ospc.unknown_exposures.response_model)

MIN_RESPONSE_SLOPE = 1e-4
"""Smallest slope of an estimated response, which must increase to have an inverse."""

# Families of curves that a model is learned from, chosen by hand to span the variety of measured responses. Triples
# are the smallest value, largest value and number of values of a parameter, in geometric progression.

FAMILY_GAMMAS = (0.6, 4.5, 14)
"""Exponents g of the powers x^(1/g)."""
FAMILY_TOE_GAMMAS = (1.2, 3.5, 6)
"""Exponents of powers with a linear toe, like video curves."""
FAMILY_TOES = (0.002, 0.01, 0.03)
"""Irradiances at which the linear toe ends."""
FAMILY_LOGARITHMS = (1.5, 400.0, 12)
"""Factors a of the logarithms ln(1 + a x)."""
FAMILY_SIGMOID_POWERS = (1.0, 1.2, 1.5, 1.9)
"""Powers p of the sigmoids x^p / (x^p + c)."""
FAMILY_SIGMOID_MIDDLES = (0.05, 2.0, 5)
"""Values of c of the sigmoids: x^p at half of the limit."""
FAMILY_KNEES = ((0.05, 0.3), (0.1, 0.45), (0.3, 0.6), (0.5, 0.8), (0.6, 0.75))
"""Irradiance and grey level of the knee of curves made of two straight lines."""
EVERY_WITH_KNEE = 5
"""Every n-th curve without a knee is averaged with each of these; using every curve would outweigh the others."""

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
