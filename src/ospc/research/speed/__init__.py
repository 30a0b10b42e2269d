"""The speed benchmark: each preset against decoding the same frames."""
