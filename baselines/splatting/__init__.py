"""3D Gaussian splatting (Kerbl et al. 2023): Gaussians, an exact CPU rasterizer, densification and the trainer."""
