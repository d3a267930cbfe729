"""What every training needs: a loop, checkpoints, devices, the training photographs.

    loop.py                 steps, checkpoints, signals and progress; read it first
    signals.py              how a training is stopped; its clock
    checkpoints.py          states in one file, and what they have to agree with
    images.py               the training photographs in memory
    config.py               settings that trainings of scenes share
    numbers.py              checks of numeric settings
    devices.py              CPU or GPU; nvidia.py: what a machine has for it
    torch_state.py          modules of torch as arrays, and back

    supervised_training.py  training of networks from pairs; learning_curve.py, validation.py: how well it goes
    network_commands.py     what the commands of these networks share

Gaussians, radiance fields and networks learn in the same loop.
"""
