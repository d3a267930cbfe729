"""Rainy image enhancement: the network of DeRainGS, its training on drawn rain, and its weights.

One picture goes in, the same picture without rain comes out; nothing is known of the scene.

    enhance.py        pictures of any size, in overlapping tiles where they are large
    companions.py     which photographs of a capture are enhanced together
    views.py          a scene's training photographs, each enhanced once and kept; clear_pixels.py between drops
    weights.py        trained networks, the shipped one in weights/
    architecture/     the network, its parts, and the statistics of the lens that they receive
    training/         the loss, and the pairs that are drawn or read; the loop is baselines.supervised
    validation/       errors on held-out photographs in known rain
"""
