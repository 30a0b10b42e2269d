"""The accuracy benchmark: a fixed set of recordings with known truth."""
