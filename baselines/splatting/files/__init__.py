"""Gaussians on disk: checkpoints, models, .ply files."""
