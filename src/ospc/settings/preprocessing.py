"""Preprocessing of frames, and the points and pixels that are sampled from them."""

# Preprocessing (ospc.correspondence.preprocessing)

FLATNESS_PX = 2.5
"""Standard deviation of the smoothing before gradients are taken, in reduced pixels: the distance over which the
image has to be flat."""

REGISTRATION_SIDE_PX = 400
"""Frames are registered at the reduced size or its first half, quarter, … that is at most this long."""

BLACK_MARGIN_PX = 3
MAX_BLACK_SHARE = 0.25
"""Half the side of the square in which black pixels are counted, and their largest share at an exposed point; none
may be masked. In the dark, noise alone makes some pixels black, and its effect on the mean is corrected; a larger
share has other causes."""

WHITE_MARGIN_PX = 5
MAX_WHITE_SHARE = 0.02
"""The same for white pixels. Noise hardly clips there, but the peaks of texture do: with a quarter of white pixels
and 3 px, ln g at grey 225 to 240 was off by up to 0.02."""

# Sampling of flat points (ospc.correspondence.flat_sampling)

SAMPLING_MARGIN_PX = 5
"""Points closer to the border than this, in reduced pixels, are not used: their surroundings are not seen whole."""

# A stationary camera (ospc.correspondence.static_series)

SERIES_PIXELS = 12_000
"""Number of pixels kept: eight times the scene points of the presets, so that they include dark and bright ones."""

SERIES_FRAMES = 256
"""Maximum number of frames kept; beyond it, every second one is dropped and only every second new one is kept."""
