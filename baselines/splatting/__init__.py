"""3D Gaussian splatting (Kerbl et al. 2023): Gaussians, an exact CPU rasterizer, densification and the trainer.

    trainer.py         the training, and a step of it; read it first
    config.py          its settings
    gaussians.py       the parameters
    rasterizer.py      images of Gaussians on the CPU, and gradients back
    state.py           what training changes beside them: moments, and how Gaussians come and go
    schedule.py        what depends on the iteration alone
    objective.py       what renders are compared with: where a method puts its own idea

    backends/          where a step runs: on the CPU, or by gsplat on a GPU
    kernels/           what the CPU's rasterizer, the loss and Adam are compiled from
    strategies/        the first Gaussians; when some are added, moved and removed
    appearance/        Gaussians whose colours differ from view to view
    files/             checkpoints, models and .ply

The method is `baselines.gaussian_splatting.GaussianSplatting`.
"""
