"""Methods that reconstruct a scene from its views, behind one contract.

method.py              the contract, and methods by name; read it first
gaussian_splatting.py  3dgs, from which all methods of Gaussians derive; splatting_profiles.py: their settings
nerf_w.py              nerf-w, a radiance field in one file
clean_wrapper.py       any method on the clean photographs

training/              what every training needs
splatting/             training of Gaussians
volumetric/            training of radiance fields
supervised/            training of networks from pairs, and their weights
rendering/             videos of trained scenes
masking/               weights of pixels: what is not of the scene
encoders/              networks that look at photographs

distractors/, nimbus/, gs_w/, wild_gs/, wild_gaussians/    methods of Gaussians
ha_nerf/, cr_nerf/, occ_nerf/, derain_nerf/                radiance fields
"""
