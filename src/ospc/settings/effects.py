"""Constants of effects other than response and vignette: their meaning, unit and the reason for their value.

"Chosen by hand" and "no effect" are explained in :mod:`ospc.settings.fit`.
"""

# Effects other than response and vignette (ospc.estimation.effects)
#
# Each has three standard deviations: in cameras with the effect, in cameras where it goes unnoticed, and of spurious
# values in clean recordings beyond chance. The second was chosen by hand. The third is about a quarter of the largest
# values in 47 clean simulated recordings, unless it says otherwise, so that none of these is significant.

BEYOND_WHITE = 0.6
"""Mean irradiance of white pixels in excess of that at white, relative to that at white: their grey level hides how
bright they are, but they cause glare, too. It was 0.3 to 0.9 in eight simulated recordings. With zero, glare of 2 per
cent was estimated as 2.5. In another simulator it was 0.1 to 4; the difference is estimated as glare of white
pixels."""
LIGHT_FIT_FLOOR = 0.1
"""Irradiance, relative to that at white, above which the polynomial in the grey level fits g with equal relative
errors, and below which it does so with equal absolute errors: few surroundings are darker. Without it, the error of
dark surroundings is three times as large for the simulator's filmic response."""
GLARE = (0.03, 0.03, 0.0005)
"""Veiling glare, as a share of the frame's mean irradiance. All lenses have some, mostly 1 to 5 per cent."""
SCATTER = (0.03, 0.03, 0.001)
"""Light scattered nearby, as a share of the irradiance of the surroundings. All lenses have some. In 68 clean
recordings, chance explained the values: they were 1.1 standard deviations in the root mean square."""
WIDE_SCATTER = (0.03, 0.0, 0.001)
"""Light scattered widely, as a share of the irradiance of the surroundings; it is stated only if it is found. With 2
and 5 per cent of it, kappa was 0.0003 to 0.0032 in ten simulated recordings; with light scattered nearby only, 0.0007
to 0.0126."""
WHITE_GLARE = (0.03, 0.0, 0.0002)
"""Glare of white pixels beyond that assumed, as a share of white, in the frame with most of them. None was found in
30 clean recordings."""
ADDED_LIGHT_MODEL_ERROR = 0.07
"""Standard deviation of the amount of added light that is corrected, as a share of it. In simulated recordings,
veiling glare of 0.01 to 0.05 was found to within 0.05 of its amount with three cameras, and 0.08 to 0.19 too low with
a fourth; 0.1 of light scattered nearby was found to within 0.05."""
FIXED_LIGHT = (0.03, 0.0, 0.0001)
"""Light that is fixed to the camera, at a typical exposure, as a share of the irradiance at white. In 68 clean
recordings, chance explained the values: they were 1.0 standard deviation in the root mean square. With 0.0004, a dark
signal of 0.0018 of white in 8 ms was not corrected, although it was found with 17 standard deviations, and V was off
by 0.007, five standard deviations."""
GLARE_SHAPE = (0.03, 0.0, 0.0005)
"""Glare that is stronger or weaker in a part of the image, as a share of the frame's mean irradiance."""
CENTRE_RADII = (0.2, 0.4)
"""Radii of two spots in the centre, in half diagonals, at which their light has fallen to 1/e. In eleven simulated
recordings with reflections of a Gaussian profile, V was off by 0.004 at most; in one with a single radius of 0.3 by
0.009, and with 0.45 by 0.015, as without correction."""
OFFSET = (0.1, 0.001, 0.001)
"""Constant error of all exposures, as a share of a typical one: 25 µs at 5 ms is common, and 5 µs goes unnoticed.
With 0.1 for the second value, exposures with random errors of 1 per cent gave bands four times as wide as the errors.
With 0.005, 82 per cent of the response's shape were within one standard deviation in 28 clean recordings, with this
value 79."""
GAIN_STEP = (0.03, 0.0, 0.0006)
"""Step of ln of the gain at one exposure: a conversion gain or an entry of a gain table that is not exact. Clean
recordings had at most 0.0012, and 0.0003 on average."""
STEP_EXPOSURES, GAIN_STEP_MODEL_ERROR = 15, 0.1
"""Number of exposures at which a step of the gain is looked for; they divide the observations into sixteen equal
parts; and standard deviation of a step that is found, as a share of it, because it may lie between two of them."""
EXPOSURES_PER_CURVE, MOST_CURVES = 4, 2
"""Number of different exposures that is needed for each curve of their errors (an offset, a step of the gain), and
largest number of such curves. Further errors are left to the latent gains of frames. With 20 exposures, each wrong by
2 per cent, up to nine steps were found, and kappa was 0.06 at a tenth of that stated; with seven, each wrong by 1 per
cent, an offset and a step were found, and the error was 14 standard deviations."""
LIGHT_DRIFT, LIGHT_DRIFT_FRAMES = (0.05, 0.02, 0.001), 100
"""Rise of ln of the light over the recording: lamps and daylight change by 2 per cent unnoticed. In 13 simulated
recordings without drift, chance explained the values, 0.0013 in the median and 0.008 at most. In fewer frames than
this, it rises in proportion less."""
MOST_RAMP_CORRELATION = 0.9
"""Correlation of ln exposure with time above which a drift of the light is not corrected if the camera moves, but
widens the uncertainty: it is almost a power of the exposures. In a slow ramp with 0.95, a drift of 0.088 ± 0.013 was
found in constant light; with its correction, ln g(0.75)/g(0.25) was off by 9 standard deviations."""
NOMINAL, LEAST_NOMINAL, MOST_NOMINAL = (1.0, 0.0, 0.01), 0.5, 1.5
"""Share of the distance of the exposures from the closest third or half of a stop by which they are wrong, 1 if they
are nominal shutter speeds; and its plausible range. 48 recordings with other exposures had at most 0.0013, or 0.011
with errors of the exposures."""
DIFFERENT_LOG_EXPOSURE, MIN_STEP_EXPOSURES = 0.02, 3
"""Difference of ln of the exposure at which two exposures count as different, and number of different ones that is
needed on both sides of a step: with two exposures, any step is also a power of the exposures."""
LATENESS = (0.3, 0.03, 0.01)
"""Lag of all exposures in frames, after correction by whole frames: exposures that are time-stamped, interpolated or
averaged have one."""
LATENESS_MODEL_ERROR = 0.1
"""Share of a lag by which the real one may differ: interpolation between frames, which corrects it, also smooths the
exposures. With the mean of two frames' exposures, a lag of 0.48 frames and a spurious offset were found together, and
the exponent of the response was off by 0.074, 3.6 standard deviations; by 1.9 with this error."""
MOST_LATE_FRAMES = 1.0
"""Largest such lag: more is corrected by whole frames."""
LOCAL_TONE = (0.1, 0.0, 0.0015)
"""Exponent by which bright surroundings brighten a point; negative if they darken it. Noticeable tone mapping has
-0.1 or stronger; equalisation within tiles of the image had 0.2. In 68 clean recordings, chance explained nearly all
values: they were 1.1 standard deviations in the root mean square. With 0.005 instead of 0.0015, an exponent of -0.03
went unnoticed, although it was found with 15 standard deviations."""
CURVATURE = (0.3, 0.0, 0.002)
"""Curvature of true ln exposure over the stated one: logarithms stored as exposures have about 0.4."""
RESPONSE_DRIFT = (0.1, 0.0, 0.003)
"""Half the change of ln γ from the first to the last group."""
BLACK_DRIFT = (0.1, 0.0, 0.0005)
"""Half the change of the black level, as a share of white."""
BLACK_BY_EXPOSURE = (0.1, 0.0, 0.0005)
"""Rise of the black level, as a share of white, when the exposure increases by a factor of e. In 97 simulated
recordings it was at most 3.2 standard deviations, and at least 5.6 if the gain raised the black level by 0.008 of
white."""
VIGNETTE_DRIFT = (0.1, 0.0, 0.002)
"""Half the change of ln V at the corner, or of its sideways slope per half diagonal. For the latter, clean recordings
had at most 1.7 standard deviations."""
VIGNETTE_BY_EXPOSURE = (0.1, 0.0, 0.001)
"""Rise of ln V at the corner when the exposure increases by a factor of e. 47 clean recordings had at most 2.1
standard deviations; corners 6 per cent darker at 1 ms than at 16 ms had 5."""
SQUARE_VIGNETTE = (0.1, 0.0, 0.0015)
"""Factor on R⁴ cos 4φ in ln V. In 58 clean recordings it was at most 0.0066, and at most 2.2 standard deviations by
chance alone. Shading corrected on a coarse grid had 0.02 to 0.2, and a V that was wrong by 0.016."""
MAX_ADDED_SHARE = 0.9
"""Largest share of added light at a point: keeps the logarithm finite on the way to the solution."""
MIN_EXPOSURE_FACTOR = 0.1
"""Smallest ratio of the true to the stated exposure, for the same reason."""
DARKEST_IRRADIANCE = 1e-3
"""Irradiances (not grey levels) below this, relative to white, are raised to it when added light is divided by them.
Below the black level of limited-range video g is almost zero, and single samples would dominate."""

# Selection of effects (ospc.estimation.effect_choice)

SUSPECTED_SIGMAS = 1.5
"""Significance, in standard deviations, above which an effect is fitted jointly with all other parameters. A single
Newton step is a weak test, because the effect itself adds to the scatter by which it is judged."""
ABSORBED_FRAME_LIGHT, ABSORBED_NEARBY_LIGHT = 0.35, 0.5
"""Quantiles of the additional light that the response contains while effects are fitted: of the mean light of frames
and of the light of the surroundings. Smaller quantiles make fits converge more slowly: with the minimum, glare of
0.05 was estimated as 0.03."""
SUSPECTED_LIGHT_SIGMAS = 2.0
"""The same for added light, by chance alone. Near black, ln g is so nonlinear in added light that one step may go
only a tenth of the way."""
MIN_GROUPS = 30
"""Minimum number of pairs of frames for judging effects. None were found in 170 parts, of 45 to 90 pairs, of clean
simulated recordings, nor in 60 complete ones with 39 to 120 pairs."""
MOST_ADDED_LIGHT, MOST_OFFSET = 0.1, 0.3
"""Largest additional light and exposure offset of real lenses, sensors and shutters."""
SIGNIFICANT_SIGMAS, SIGNIFICANT_SIGMAS_IN_ALL = 5.0, 3.0
"""Significance above which a fitted effect counts, in standard deviations due to chance and to the errors of clean
recordings; and in standard deviations that include the disagreement between halves of the observations."""
CONTRADICTING_SIGMAS = 5.5
"""The same for the geometric mean of both, for a contradiction: it causes a warning, and if it is left out, its
possible size widens the uncertainty all the same. Tone mapping, a digital zoom of 1.2 with a weak vignette and a
square vignette had 5.5 to 9. A hundred recordings without contradiction had at most 5.2 by chance alone; four more,
with a fisheye lens or with small images of 160×120 to 320×256 pixels, had 5.2 to 13, and a mean of at most 5.2."""
MOST_SCATTERED_SHARE = 0.3
"""Scattered light, relative to the other light of a point, from which the point cannot show a contradiction: it is
known to a few per cent only, because the light of white pixels is unknown. With 4 per cent scattered nearby and 2 of
glare, a recording seemed to have a black level that depends on the exposure, by 0.011 ± 0.002 of white; without these
points, a tenth of all, by 0.003 ± 0.002. Simulated ones of 0.01 stayed significant."""
EFFECT_PROBABILITY, CONTRADICTION_PROBABILITY = 0.3, 0.02
"""Prior probability that a camera has an effect that matters, and that a recording contradicts the model: few
recordings are tone mapped. They determine how much an effect that is left out widens the uncertainty: with 100 pairs,
an effect of 2.5 standard deviations counts half, and a contradiction of 3.5. With 0.5 instead of 0.3, a spurious
offset of 2.2 standard deviations made the response of a short recording marginal; with 0.1 instead of 0.02, spurious
tone mapping of 1.7 widened the band of a real video by half."""
PREFERRED_SHARE = 0.9
"""Significance, relative to the clearest effect, above which an effect of a camera is tried before a contradiction:
an offset of the exposures also resembles a curvature of their logarithm."""
