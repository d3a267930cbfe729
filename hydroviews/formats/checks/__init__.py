"""A capture compared with itself when it is read: cameras, points, pixels, depth and masks describe one scene."""
