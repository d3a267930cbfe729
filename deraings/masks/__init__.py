"""Occlusion masks: what of each photograph is not the scene.

occlusion_masks.py   the masks of a scene's training views, learned with the scene
network.py           the network that predicts them, and its loss
maps.py              planes in the network's blocks, and what the losses of many views tell about the lens
config.py            settings
"""
