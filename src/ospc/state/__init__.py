"""State files: a container with a checksum, and the dataclasses stored in it."""
