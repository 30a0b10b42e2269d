"""What several recordings of one camera say together."""
