"""Captures on disk: the readers and writers of COLMAP, nerfstudio, LLFF and NSVF."""
