"""The page of a guided capture, and the server that shows it on this machine."""
