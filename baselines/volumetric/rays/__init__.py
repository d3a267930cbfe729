"""Rays and the pixels they belong to: batches, grids in photographs, the space of a field, samples along rays."""
