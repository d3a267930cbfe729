"""A capture from a video: sharp frames, masks drawn by the user."""
