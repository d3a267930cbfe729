"""Structure from motion: cameras and points from photographs, with pycolmap."""
