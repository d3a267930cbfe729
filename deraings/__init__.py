"""DeRainGS, the method the benchmark is named after, and its continuation that models the rain.

    method.py            DeRainGS (the paper's), DeRainGSPlus (ours), and classes that leave parts out, for the ablation
    enhanced_method.py   any method on enhanced photographs: `3dgs+enhance`
    reconstruct.py       one's own rainy photographs in, a clean scene out: `python -m deraings reconstruct`
    image_planes.py      one value a pixel, at other sizes
    enhancement/         the network that takes rain out of photographs: its parts, its training, its weights
    masks/               occlusion masks: what of each photograph is not the scene
    rain_model/          mist, drops, falling rain and single streaks, learned while the scene is learned

A method of splatting trains Gaussians with `baselines.splatting`; DeRainGS puts its own objective
(`rain_model/objective.py`) in the place of the photometric loss.
"""
