"""From correspondences to curves: response, vignette, exposure ratios and their uncertainty."""
