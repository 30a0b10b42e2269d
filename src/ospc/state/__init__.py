"""Values on disk that can be continued and added to one another: one safe container, and typed values in it."""
