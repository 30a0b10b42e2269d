"""States in files: a checksummed container, and dataclasses packed into it."""
