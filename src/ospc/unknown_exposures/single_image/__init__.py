"""Response and vignette from single images, whose exposures say nothing."""
