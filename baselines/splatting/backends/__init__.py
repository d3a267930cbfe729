"""Where a training step runs: the CPU's own kernels, or gsplat on a GPU."""
