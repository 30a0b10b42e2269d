"""What the images say about the exposures: lag, stale metadata, hidden gain, flicker, tone mapping."""
