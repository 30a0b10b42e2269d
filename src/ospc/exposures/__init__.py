"""Check exposures against the images: lag, stale metadata, unrecorded gain, flicker, tone mapping."""
