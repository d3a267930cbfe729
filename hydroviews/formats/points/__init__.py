"""Point clouds: PLY files, and points that a cloud has several times."""
