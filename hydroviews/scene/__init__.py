"""A scene: views with cameras, pictures, masks and depth, and the points between them."""
