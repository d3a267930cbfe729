"""Rainy image enhancement: the network of DeRainGS, its training on drawn rain, and its weights.

One picture goes in, the same picture without rain comes out; nothing is known of the scene.

    enhance.py        pictures of any size, in overlapping tiles where they are large
    network.py        the network; mist_branch.py takes mist off the whole picture first; size.py counts operations
    weights.py        trained networks on disk, the shipped one in weights/
    views.py          a scene's training photographs, each enhanced once and kept
    training.py       the training: config.py, loss.py, validation.py; data from data.py, pairs.py, pair_folders.py
"""
