"""Occlusion masks: what of each photograph is not the scene.

Masks weigh the photometric loss; a network that sees the photographs predicts them, and learns from that loss.

    occlusion_masks.py   the masks of a scene's training views, learned with the scene
    network.py           the network that predicts them, and its loss
    maps.py              planes in the network's blocks, and what the losses of many views tell about the lens
    config.py            settings
"""
