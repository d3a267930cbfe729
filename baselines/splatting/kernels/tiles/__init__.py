"""Splats sorted into the tiles of the image, blended there front to back, and the gradient of blending."""
