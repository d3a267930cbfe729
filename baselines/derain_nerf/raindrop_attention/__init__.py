"""Attentive raindrop detection and removal (Qian et al. 2018): the network, its training on drawn rain, its weights."""
