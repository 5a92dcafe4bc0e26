"""The store on the disk: artifacts by their content keys, and files that are written whole."""
