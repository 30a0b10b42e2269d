"""What a recording can and cannot tell."""
