"""What the operating system provides: files, folders, processes and threads."""
