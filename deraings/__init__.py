"""DeRainGS (Liu et al. 2025), re-implemented, and our method with a model of the rain.

    method.py            DeRainGS (the paper's), DeRainGSPlus (ours), and classes that leave parts out, for the ablation
    enhanced_method.py   any method on enhanced photographs: `3dgs+enhance`
    reconstruct.py       your own rainy photographs in, a clean scene out: `hydroviews reconstruct`
    image_planes.py      one value a pixel, at other sizes
    enhancement/         the network that removes rain from photographs: its parts, its training, its weights
    masks/               occlusion masks: weights of the pixels that something hides
    rain_model/          mist, drops, falling rain and single streaks, learned while the scene is learned

A method of splatting trains Gaussians with `baselines.splatting`; DeRainGS puts its own objective
(`rain_model/objective.py`) in the place of the photometric loss.
"""
