"""The parts of GS-W, Gaussian in the Wild (Zhang et al. 2024)."""
