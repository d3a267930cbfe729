"""The CPU rasterizer: projection, sorting into tiles, blending, and their gradients, compiled by Numba."""
