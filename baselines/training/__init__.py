"""What every training needs: a loop, checkpoints, devices, the training photographs.

    loop.py                 steps, checkpoints, signals and progress; read it first
    signals.py              how a training is stopped; its clock
    checkpoints.py          states in one file, and what they have to agree with
    images.py               the training photographs in memory
    config.py               settings that trainings of scenes share
    devices.py              CPU or GPU; nvidia.py: what a machine has for it
    torch_state.py          modules of torch as arrays, and back
    learning_curve.py       how well it goes

Gaussians, radiance fields and networks learn in the same loop.
"""
