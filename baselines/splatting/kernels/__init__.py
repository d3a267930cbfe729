"""What is compiled by Numba for the CPU.

    jit.py        how kernels are compiled and cached; simd.py: for which instructions
    splats/       projection of Gaussians, and its gradient
    tiles/        sorting into tiles, blending, and its gradient
    vector/       vectors of numbers, which the kernels calculate with
    photometric.py, loss_map.py, loss_sweep.py   the loss
    adam.py, mcmc.py                             steps of the optimiser, and the noise of relocation

The rasterizer that calls them is `baselines.splatting.rasterizer`.
"""
