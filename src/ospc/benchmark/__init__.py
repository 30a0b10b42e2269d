"""The accuracy benchmark: a fixed set of recordings whose truth is known, every method, every metric."""
