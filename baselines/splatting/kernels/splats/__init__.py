"""From Gaussians to splats in the image, and gradients back: geometry, projection, colours of spherical harmonics."""
