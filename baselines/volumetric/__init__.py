"""Radiance fields: rays, spaces, fields, samplers, compositing and their training, shared by the NeRF-style methods.

    method.py        a radiance field as a method, from which others derive; read it first
    config.py        settings
    trainer.py       the training; batches.py: its pixels; losses.py: its losses
    model.py         a field that is rendered along rays, in this order:

    rays.py          rays of cameras
    spaces.py        the space that a field lives in
    sampling.py      where along rays it is asked
    encodings.py     positions and directions for networks; hash_grid.py, hash_kernels.py: learned ones
    fields.py        density and colour
    compositing.py   from densities to pixels

For fields that learn from whole photographs: photographs.py, grids.py (pixels in regular grids), masking.py.
"""
