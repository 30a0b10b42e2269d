"""The engine: everything that happens to a frame, from its check to the verdicts."""
