"""Radiance fields: rays, spaces, fields, samplers, compositing and their training, shared by the NeRF-style methods."""
