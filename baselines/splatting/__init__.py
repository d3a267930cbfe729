"""3D Gaussian splatting (Kerbl et al. 2023): Gaussians, an exact CPU rasterizer, densification and the trainer.

    trainer.py         the training, and a step of it; read it first
    config.py          its settings
    gaussians.py       the parameters; initialisation.py: what they start from
    state.py           what training changes beside them: moments, and how Gaussians come and go
    schedule.py        what depends on the iteration alone
    objective.py       what renders are compared with: where a method puts its own idea

    backends/          where a step runs: on the CPU, or by gsplat on a GPU
    kernels/           the CPU's rasterizer and its gradients
    strategies/        when Gaussians are added, moved and removed
    appearance/        Gaussians whose colours differ from view to view
    files/             checkpoints, models and .ply

The method is `baselines.gaussian_splatting.GaussianSplatting`.
"""
