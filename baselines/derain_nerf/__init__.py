"""DerainNeRF (Li et al. 2024): a radiance field that learns nothing under drops."""
