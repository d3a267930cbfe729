"""When Gaussians are added, moved and removed."""
