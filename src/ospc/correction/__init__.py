"""Whole recordings with response and vignette taken out of them."""
