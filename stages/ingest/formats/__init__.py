"""The file formats of point clouds. Each module reads one, and detects damaged, odd and oversized files."""
