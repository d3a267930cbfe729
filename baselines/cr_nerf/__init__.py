"""The parts of CR-NeRF, Cross-Ray Neural Radiance Fields (Yang et al. 2023)."""
