"""Pictures of calibrations: values in, image files out."""
