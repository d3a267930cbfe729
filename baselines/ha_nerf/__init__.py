"""The parts of Ha-NeRF, Hallucinated Neural Radiance Fields in the Wild (Chen et al. 2022)."""
