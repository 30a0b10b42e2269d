"""Response and vignette from single images, without exposure changes."""
