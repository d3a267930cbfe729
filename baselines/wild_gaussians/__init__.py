"""The parts of WildGaussians: appearance by view, uncertainty from frozen features, Gaussians for the sky."""
