"""The parts of Wild-GS (Xu et al. 2024)."""
