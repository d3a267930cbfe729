"""The same steps on the CPU's kernels and on gsplat's, whose kernels are replayed."""

from dataclasses import replace

from looks import assert_the_same_steps

from baselines.wild_gs.appearance import LookAppearance
from baselines.wild_gs.config import SHORT


def test_the_gpu_takes_the_same_steps(tmp_path, cuda_backend):
    look = replace(SHORT, visible_from=0.02, local_from=0.01, absent=0.0, side=16, box=1.8)
    assert_the_same_steps(tmp_path, cuda_backend, lambda images: LookAppearance(images, look, 1, 100, 0, 0.01))
