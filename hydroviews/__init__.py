"""The data set generator: adds rain with known parameters to clean multi-view captures.

HydroViews is the data set of Liu et al. (AAAI 2025); this is an independent implementation of its generator.

files      writing whole or not at all, locks, folders that belong to one set of settings
scene      cameras, lenses, views, images, masks, depth
formats    captures on disk: `formats.read.read_scene` reads COLMAP, nerfstudio, LLFF and NSVF
captures   captures by name, downloads, camera poses from photographs, captures from videos
rain       effects, their severity and patterns
blender    rendering in Blender processes, and the embedded scenes
dataset    building, verifying and describing a data set; `dataset.build` is the place to start
pairs      rainy and clean pictures to train networks on
metrics    PSNR, SSIM, LPIPS and the others
torch      a built or packed variant as a PyTorch data set
"""

__version__ = "1.0.0"
