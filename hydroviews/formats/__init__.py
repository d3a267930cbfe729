"""Captures on disk: readers of COLMAP, nerfstudio, LLFF and NSVF, writers of COLMAP and nerfstudio."""
