"""The same steps on the CPU's kernels and on gsplat's, whose kernels are replayed."""

from dataclasses import replace

from looks import assert_the_same_steps

from baselines.gs_w.appearance import ReferenceAppearance
from baselines.gs_w.config import SHORT


def test_the_gpu_takes_the_same_steps(tmp_path, cuda_backend):
    config = replace(SHORT, visible_from=0.02)
    assert_the_same_steps(tmp_path, cuda_backend, lambda images: ReferenceAppearance(images, config, 1, 100, 0))
