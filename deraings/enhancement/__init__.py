"""Rainy image enhancement: the network of DeRainGS, its training on drawn rain, and its weights."""
