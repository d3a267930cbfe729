"""Radiance fields: rays, spaces, fields, samplers, compositing and their training, shared by the NeRF-style methods.

    method.py        a radiance field as a method, from which others derive; read it first
    config.py        settings
    trainer.py       the training; losses.py: its losses
    model.py         a field that is rendered along rays
    rays/            rays of cameras, the space that a field lives in, where along rays it is asked, batches of pixels
    fields/          encodings, hash grid, density and colour
    compositing.py   from densities to pixels

Masks of rays are in `baselines.masking.rays`.
"""
