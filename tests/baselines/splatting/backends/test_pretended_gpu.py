"""The pretended GPU notices what a real one would refuse, and what it would wait for."""

import numpy as np
import pytest
import torch


def test_tensors_know_where_they_are(pretended_gpu):
    here, there = torch.ones(3), torch.ones(3).cuda()
    assert [t.device.type for t in (here, there, there[1:] + 1, there.cpu())] == ["cpu", "cuda", "cuda", "cpu"]
    assert torch.zeros(2, device="cuda").is_cuda
    assert there.new_zeros(2).is_cuda
    assert not here.to(torch.float64).is_cuda
    assert here.to(there).is_cuda
    assert torch.nn.Linear(2, 2).to("cuda").weight.is_cuda
    assert there.cpu().numpy().sum() == 3


def test_gradients_stay_where_their_tensors_are(pretended_gpu):
    leaf = torch.ones(3).cuda().requires_grad_()
    (leaf[:2] * 2).sum().backward()
    assert leaf.grad.is_cuda
    assert leaf.grad.cpu().tolist() == [2, 2, 0]


def test_what_a_gpu_refuses_is_refused(pretended_gpu):
    here, there = torch.ones(3), torch.ones(3).cuda()
    for wrong in (lambda: here + there, lambda: torch.cat([here, there]), lambda: here * there.sum()):
        with pytest.raises(RuntimeError, match="same device"):
            wrong()
    assert (there * torch.tensor(2.0)).is_cuda  # single numbers may come along
    for reading in (there.numpy, lambda: np.asarray(there)):
        with pytest.raises(TypeError, match="to numpy"):
            reading()
    with pytest.raises(RuntimeError, match="generator"):
        torch.randn(3, generator=torch.Generator(), device="cuda")
    assert torch.randn(3, generator=torch.Generator("cuda"), device="cuda").is_cuda


def test_what_takes_time_is_counted(pretended_gpu):
    there = torch.ones(3).cuda()
    there.new_tensor([1.0])
    there[torch.tensor([0, 1])] = 0.0  # the indices, behind one's back
    assert pretended_gpu.counts == {"uploads": 3}
    pretended_gpu.counts.clear()
    assert there.any()
    assert len(there[there > 0]) == 1
    assert float(there[2]) == 1
    assert pretended_gpu.counts == {"questions": 3}
    there.cpu()
    assert pretended_gpu.counts["downloads"] == 1


def test_kernels_take_what_gsplats_take(pretended_gpu):
    from gsplat import isect_tiles

    centres, radii, depths = torch.ones(1, 1, 2) * 20, torch.ones(1, 1, 2, dtype=torch.int32), torch.ones(1, 1)
    with pytest.raises(RuntimeError, match="centres must be a CUDA tensor"):
        isect_tiles(centres, radii, depths, 16, 3, 2)
    with pytest.raises(RuntimeError, match="depths of type Float"):
        isect_tiles(centres.cuda(), radii.cuda(), depths.double().cuda(), 16, 3, 2)
    _, keys, splats = isect_tiles(centres.cuda(), radii.cuda(), depths.cuda(), 16, 3, 2)
    assert splats.cpu().tolist() == [0]
    assert (keys >> 32).cpu().tolist() == [4]  # the second tile of the second row
