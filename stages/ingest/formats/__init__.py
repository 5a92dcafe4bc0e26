"""The file formats of point clouds: each module reads one, and notices a damaged, odd or oversized file."""
