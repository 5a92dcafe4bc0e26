"""What lies on the disk while the pipeline works: artifacts by their content keys, and files written whole."""
