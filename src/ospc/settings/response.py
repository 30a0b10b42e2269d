"""Constants of the response's basis and prior: their meaning, unit and the reason for their value.

"Chosen by hand" and "no effect" are explained in :mod:`ospc.settings.fit`.
"""

# The response basis (ospc.estimation.response_basis)

RESPONSE_GRID_STEPS = 4096
"""Number of steps of the grey-level grid on which the basis is tabulated. A step is a sixteenth of an 8-bit grey
level, far below any noise, so the model can be linearised at the nearest grid point."""
QUADRATURE_POINTS = 4
"""Number of Gauss-Legendre nodes per grid step."""
FIRST_GRID_STEP_BEGINS = 0.25
"""Start of the integral over the first grid step, in steps: ln g tends to minus infinity at black."""
TYPICAL_GAMMA_BLACK = 1.1
TYPICAL_GAMMA_RISE = 0.9
"""Typical local gamma at black, and its linear rise from black to white. They follow the medians of the 201 measured
responses of Grossberg and Nayar (2003) up to grey level 0.8."""

# The prior of the response (ospc.estimation.prior)

LEVEL_SIGMA = 0.6
"""Standard deviation of the logarithm of a camera's gamma about the typical one. Two thirds of the 201 measured
responses of Grossberg and Nayar (2003) lie within it."""
SLOPE_SIGMA = 1.0
"""Standard deviation of the slope of ln γ over all grey levels. 0.5 and 2 raise the shape error by a tenth."""
SHOULDER_SIGMA = 0.5
"""Standard deviation of the change of ln γ between :data:`SHOULDER_GREY` and white that does not continue the curve
below. In two thirds of the 201 measured responses, this change lies between none and a factor of 2.6."""
SHOULDER_GREY = 0.75
"""Grey level above which this change takes place, linearly. Chosen by hand; 0.85 has no effect, 0.65 lowered κ by a
fifth on these six recordings."""
TOE_SIGMA = 0.5
"""Standard deviation of the change of ln γ between :data:`TOE_GREY` and black that does not continue the curve above,
as that of the shoulder: sRGB and Rec. 709 are straight near black. Without it, smooth curves of eight recordings were
continued to black with errors of up to 5.4 standard deviations, 0.63 in ln g; with it, up to 4.5 and 0.06. 1 has no
further effect; κ and shape stay the same."""
TOE_GREY = 0.12
"""Grey level below which this change takes place, linearly. 0.2 left errors of 0.42 in ln g."""
WHITE_SIGMA = 0.3
"""Standard deviation of a further deviation of ln γ in the last few grey levels. 0.42, closer to the measured
responses, made the results of complete runs worse."""
BLACK_SIGMA = 0.2
"""Standard deviation of a further deviation of ln γ in the first few grey levels. Chosen by hand; 0.1 raises κ by a
quarter, 0.4 the shape error by a seventh."""
END_EXPONENT = 40
"""These two variances decrease with this power of the grey level (at black, of one minus the grey level): they halve
within 4.4 8-bit grey levels. Chosen by hand; 20 raises the shape error and 80 raises κ, both by a third."""
PRIOR_MIDDLE_GREY = 0.4
"""Grey level from which the random walks start towards both ends. No effect from 0.3 to 0.5."""
PRIOR_NUGGET = 1e-6
"""Added to the variance of ln γ at each knot so that its covariance is invertible. No effect from 1e-7 to 1e-5."""
WALK_CANDIDATES = (0.03, 10.0, 11)
DRIFT_CANDIDATES = (0.3, 1.0, 3.0, 10.0, 30.0)
"""Candidate hyperparameters, as standard deviations of ln γ over the whole range: of the random walk (smallest,
largest, number; geometric sequence) and of the random walk of the slope. They range from a straight line to a kink at
every knot."""
KNEE_SIGMA = 1.0
"""Standard deviation of the jump of ln γ at a knee. The knees of cameras change γ by a factor of 1.5 to 6."""
KNEE_EVIDENCE, FIRST_KNEE_EVIDENCE = 6.0, 2.0
"""Least increase of the log marginal likelihood by a knee: one camera in ten may have one, at any of 47 knots. It is
lower in the first rounds, when the errors of a fit without knees hide them; later rounds decide again. With 6 in all
rounds, a knee at 0.8 by a factor of 5 was never found, although it gains 58 once the fit has it."""
MAX_KNEES = 4
"""Maximum number of knees. Cameras have up to three."""
MOST_RESPONSE_INTERVALS = 256
"""Most intervals between the knots: as many as 8-bit grey levels, and four times those of any preset."""
START_WALK = 1.0
START_DRIFT = 1.0
"""Hyperparameters until they are first selected, in the first round."""

# The black level (ospc.estimation.black_level)

BRIGHTEST_OF_BLACK_LEVEL = 0.5
"""Highest knot of the line that shows the black level: above, it changes the local gamma by less than the response's
own shape does."""
MIN_BLACK_LEVEL_KNOTS = 4
"""Minimum number of knots for a line with an error."""
MIN_RECIPROCAL_GAMMA_SIGMA = 0.001
"""Lower limit of the standard deviation of a reciprocal local gamma: between knots, it is not exactly a line."""
BLACK_LEVEL_SIGMAS, MIN_BLACK_LEVEL, BLACK_LEVEL_ACCURACY = 3.0, 1 / 64, 0.0005
"""Significance of a black level; the lowest that counts, half a knot, because the basis follows lower ones; and the
accuracy of one that counts. With pedestals of 0.04 to 0.0625, the first estimate is 0.038 to 0.0625; that of
gamma curves is 0.0000 ± 0.0005."""
MAX_BLACK_LEVEL_MISFIT = 20.0
"""Largest reduced chi-square of that line. It was 0.2 to 12 with pedestals of 8 and 16 grey levels of 255, and 32 to
290 with S-shaped responses, whose toe is not a pedestal."""
MAX_BLACK_LEVEL = 0.25
"""Highest black level: pedestals are at most a tenth of the scale, and lifted blacks of photographs hardly more."""
