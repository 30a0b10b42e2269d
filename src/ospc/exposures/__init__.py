"""What the images show about the exposures: lag, stale metadata, hidden gain, flicker, tone mapping."""
