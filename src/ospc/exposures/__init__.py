"""What is known of the exposures of frames."""
