"""Weights of the pixels of training views: what is not of the scene counts less in the loss, or not at all.

    pixel_weights.py    the protocol; read it first
    residuals.py        residuals of renders, their percentiles, and inliers among them
    trimmed.py          inliers of the residuals (robust-filter), and what fades masks in
    feature_network.py  a network on frozen features that learns which pixels are inliers (spotless)
    uncertainty.py      an uncertainty learned from features of renders and photographs (wild-gaussians)
    visibility.py       a mask that an image encoder predicts, learned from the loss that it weighs (gs-w, wild-gs)
    rays.py             masks of the rays of radiance fields, and what masking costs (ha-nerf, cr-nerf)

The occlusion masks of DeRainGS follow the same protocol: `deraings/masks`.
"""
