"""Constants of the vignette's basis and its prior: their meaning, unit and the reason for their value.

"Chosen by hand" and "no effect" are explained in :mod:`ospc.settings.fit`.
"""

# The vignette basis (ospc.estimation.vignette_basis, vignette_choice)

VIGNETTE_SIGMA = 2.0
"""Prior standard deviation of the slope of ln V in R² at the centre; further out it increases, see
:data:`DARK_RADIUS`. This is wide compared to real lenses: cos⁴ at a half angle of 45° has a slope of -2. On 42
simulated recordings, 1 and 4 changed the mean vignette error by about a tenth."""
CENTRE_SIGMA, NON_RADIAL_SIGMA = 0.1, 0.1
"""Prior standard deviations of the vignette's centre along each axis, in half diagonals, and of the non-radial terms,
in ln V: as large as in real lenses. A shift of the centre is nearly a sum of non-radial terms; with 2 for both, the
centres of decentred elliptic vignettes were wrong by up to 0.46 and the RMSE of five such cameras reached 0.23. With
these values it is at most 0.007."""
CENTRE_ERROR_FACTOR = 3.0
"""Error of a centre that the observations hardly show, relative to its standard deviation due to chance:
registration errors pull it towards the middle. In nine recordings of cameras that panned, tilted or moved straight
on, with centres off by up to 0.15, the fitted centre was wrong by 2.3 times that deviation (root mean square), and at
most by 5.7 times."""
POSSIBLE_CENTRE_SIGMA = 0.05
"""Standard deviation of the centre of a vignette, in half diagonals, if nothing shows where it is: a few hundredths
are usual, and real lenses reach 0.1."""
DARK_RADIUS = 1.2
"""Distance from the vignette's centre, in usable radii of the image, at which the smooth part of the prior lets V
reach zero, as V does at the edge of the image circle. It increases with the radius of the last knot. With powers of
R² instead of a spline, on 42 simulated recordings, 28 of them decentred, 1.3 raised the error of these from 1.25 to
1.7 standard deviations, and 1.1 raised the vignette error of the centred ones by a tenth."""
VIGNETTE_WALK_CANDIDATES = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Candidate standard deviations of the random walk of the slope over the usable image. 0.01 leaves a smooth curve,
which the cos⁴ vignettes of five recordings selected; mechanical ones selected 1."""
START_VIGNETTE_WALK = 0.1
"""That standard deviation until it is first selected, in the first round. Chosen by hand."""
VIGNETTE_REACH, VIGNETTE_REACH_STEP = 1.1, 0.05
"""Radius of the last knot of ln V, in usable radii, and the steps by which it increases until it includes the corner
farthest from the centre, which is beyond 1.1 if the centre is off by more than 0.1. Beyond the last knot the slope is
constant: with 1.1, the far corners of three vignettes with centres off by 0.18 and 0.22 were wrong by 5 to 12 per
cent. In steps, most recordings of one camera have the same knots. Chosen by hand."""
MAX_VIGNETTE_REACH = 100.0
"""Largest radius of the last knot, in usable radii: it is smaller for the farthest centre and the smallest usable
radius. Quick fits keep :data:`VIGNETTE_REACH`: after a few pairs of frames, the centre may be wrong by 0.2, and they
only serve registration."""
VIGNETTE_NUGGET = 1e-6
"""Independent variance of the slopes of ln V, which keeps their prior covariance invertible: a standard deviation of
0.001, far below that of any slope."""
ASYMMETRY_SIGMA = 0.0015
"""Apparent asymmetry caused by registration errors common to all samples, in ln V over a half diagonal; for the
centre, the shift that changes ln V by this much on average. It is added to the covariance before a free centre or
non-radial terms are accepted: without it, one of 50 centred recordings met the criterion. With 0.004, a weak vignette
decentred by 2 per cent was taken as centred, and its profile was wrong by six standard deviations."""
MAX_ASYMMETRY = 0.005
"""Standard deviation of such an asymmetry due to chance, above which the observations do not show where the
vignette's centre is. It was at most 0.0035 with hand-held cameras and forward motion, and 0.007 to 0.027 with cameras
that only panned or moved sideways. If it counted in all recordings, 84 instead of 71 per cent of the profile would be
within one standard deviation."""
MOST_RADIAL_TERMS = 32
"""Most coefficients of a vignette: twice those of any preset."""
PROMISING_SHARE = 0.25
"""Further parameters are fitted only if one Newton step, which takes a third of the time, reaches this share of the
criterion. Near the criterion, the step reached 0.5 to 0.7 of the value of the full fit."""
FIRST_FIT_POINTS = 10_000
"""Number of scene points of the first, approximate fit, which only provides the start of the full fit and saves time.
20000 has no harmful effect; 5000 raises the errors by a quarter to two thirds."""
MIN_CRITERION_GROUPS = 3
"""Minimum number of pairs of frames assumed in the criterion: the logarithm of one or two is no penalty."""
MIN_USABLE_RADIUS = 0.01
"""Smallest usable radius of a vignette, in half diagonals: a few pixels, which contain no information about it."""
