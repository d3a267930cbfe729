"""The rain as a GPU shows and learns it against the CPU's kernels, on a pretended GPU and on a real one."""

from dataclasses import replace

import cv2
import numpy as np
import panorama
import pytest
import torch
from pretended_network import PretendedNetwork
from rain_steps import let_it_rain
from splats import BACKGROUND

from baselines.splatting.backends.base import GSPLAT
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.training.devices import missing_for_cuda
from baselines.training.images import TrainingImages
from baselines.training.torch_state import fetched, sent
from deraings.image_planes import resized, surroundings
from deraings.rain_model.config import RainConfig
from deraings.rain_model.drops import DropLayer
from deraings.rain_model.kernels import add_mist, mist_gradient
from deraings.rain_model.model import RainModel
from deraings.rain_model.objective import RainObjective
from deraings.rain_model.on_gpu import MistOnGPU, RainOnGPU, averaging, behind_drops, behind_mist, enlarged

COUNT, STEPS = 8, 60
EAGER = RainConfig(start=0.1)
NOTHING = RainConfig(mist=None, drops=None, occlusion=None, rainfall=None, enhanced=0)


@pytest.fixture(params=["pretended", "real"])
def gpu(request):
    """The GPU's backend."""
    if request.param == "pretended":
        request.getfixturevalue("pretended_gpu")
    elif lacking := missing_for_cuda(GSPLAT):
        pytest.skip(f"needs an NVIDIA GPU and gsplat: {lacking}")
    from baselines.splatting.backends.cuda import CudaBackend

    return CudaBackend


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(), COUNT)


def photographs(scene):
    """Behind a drop and thin mist."""
    rainy = panorama.misted(scene, panorama.slanted_mist(0.2), np.full(3, 0.8))
    drop = np.s_[:, 10:30, 20:44]
    rainy[drop] = 0.2 * rainy[drop] + 0.8 * panorama.shaded_drop(20, 24)
    return rainy


def objective_of(scene, config=EAGER, hidden=(), even=0.0, streaks=(), **more):
    """One that has found mist and falling rain. Its loss is D-SSIM: L1 has kinks, where rounding turns gradients."""
    images = TrainingImages(panorama.eight_bit(photographs(scene)), hidden)
    objective = RainObjective(images, STEPS, config, lambda_dssim=1.0, **more)
    roots = objective.model.mist.roots
    roots[:] = np.linspace(0, 0.6, roots.size).reshape(roots.shape)
    return let_it_rain(objective, even, streaks)


def compare(gpu, scene, one, two, size=None, steps=STEPS):
    """Both take the same steps; their losses, gradients and what they have learned agree."""
    noise, buffers, backend = np.random.default_rng(0), BufferPool(), gpu(two, BACKGROUND, 0.01)
    for iteration in range(steps):
        view = iteration % COUNT
        image = np.clip(scene[view] + 0.03 * noise.standard_normal(scene[view].shape), 0.01, None).astype(np.float32)
        if size is not None:
            image = cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA)
        expected, by_render = one(image, view, iteration, buffers)
        by_render = by_render.copy()
        render = sent(image).requires_grad_()
        loss, gradient = float(backend._backward([render], view, iteration)), fetched(render.grad)
        assert loss == pytest.approx(expected, rel=1e-4), iteration
        assert np.abs(gradient - by_render).max() < 2e-3 * np.abs(by_render).max(), iteration
    for name, learned in one.state_dict().items():
        assert two.state_dict()[name] == pytest.approx(learned, rel=2e-3, abs=2e-4), name


def test_a_training_on_the_gpu_learns_the_same(gpu, scene):
    objectives = objective_of(scene), objective_of(scene)
    compare(gpu, scene, *objectives)
    model = objectives[1].model
    assert model.drop_alpha(0, scene.shape[1:3]).max() > 0.5  # it was there to be compared
    assert model.mist.steps[0] == STEPS


def test_behind_falling_rain_mist_is_learned_the_same(gpu, scene):
    """From differences alone, not from the gradient of the loss; even rain, as if it were known."""
    config = replace(EAGER, start=0.9)
    compare(gpu, scene, *(objective_of(scene, config, even=0.1) for _ in range(2)), steps=30)


def test_pixels_that_a_network_hides_count_as_little(gpu, scene):
    covers = np.zeros((COUNT, 20, 30), np.float32)
    for view, cover in enumerate(covers):
        cover[5:15, view : view + 10] = 0.9
    objectives = [objective_of(scene, covers=PretendedNetwork(covers=covers)) for _ in range(2)]
    compare(gpu, scene, *objectives, steps=20)
    assert objectives[1].weights(lambda: scene[0], 0, scene.shape[1:3], STEPS - 1, BufferPool()).min() < 0.3


@pytest.mark.parametrize("even", [0.0, 0.1])
def test_steps_with_enhanced_photographs_are_the_same(gpu, scene, even):
    """In rain as well, where mist is learned apart from the loss: it learns nothing of the photograph then."""
    error = np.linspace(0.01, 0.1, 20 * 30, dtype=np.float32).reshape(20, 30)
    network = PretendedNetwork(scene, change=lambda _: 0.7, error=error)
    config = replace(EAGER, start=0.9)
    objectives = [objective_of(scene, config, even=even, network=network) for _ in range(2)]
    due = [objectives[0].enhanced.due(step % COUNT, step) for step in range(12)]
    assert 3 < sum(due) < 9
    compare(gpu, scene, *objectives, steps=12)


def test_kept_views_teach_nothing(gpu, scene):
    objective = objective_of(scene)
    objective.trial.keeps = lambda view, iteration: view == 3
    before = {name: value.copy() for name, value in objective.state_dict().items()}
    backend, gradients = gpu(objective, BACKGROUND, 0.01), []
    for view in (3, 4):
        render = sent(scene[view].copy()).requires_grad_()
        backend._backward([render], view, 2)
        gradients.append(fetched(render.grad))
        same = all(np.array_equal(value, before[name]) for name, value in objective.state_dict().items())
        assert same == (view == 3)
    assert not gradients[0].any()
    assert gradients[1].any()


def test_single_streaks_hidden_pixels_and_small_views(gpu, scene):
    hidden = [np.zeros(scene.shape[1:3], bool) for _ in range(COUNT)]
    hidden[1][:20, :30] = True
    streaks = np.random.default_rng(1).uniform(-0.1, 0.3, scene.shape[:3])
    objectives = [objective_of(scene, hidden=hidden, even=0.1, streaks=streaks) for _ in range(2)]
    assert objectives[0].model.rain_alpha(0, scene.shape[1:3]).std() > 0.05
    compare(gpu, scene, *objectives, steps=6)
    compare(gpu, scene, *objectives, size=(23, 31), steps=6)


def test_without_rain_it_is_the_render(gpu, scene):
    objective = RainObjective(TrainingImages(panorama.eight_bit(scene)), STEPS, NOTHING)
    render = sent(scene[0].copy()).requires_grad_()
    seen = objective.on_gpu(render, 0, 5, BufferPool())
    assert seen.image is render
    assert seen.weights is None


def test_mist_is_that_of_the_kernels(gpu):
    rng = np.random.default_rng(0)
    image = rng.uniform(-0.1, 1.7, (30, 40, 3)).astype(np.float32)  # brighter light is clipped, whose slope is nobody's
    alpha = np.where(rng.random((30, 40)) < 0.2, 0, rng.random((30, 40))).astype(np.float32)
    colour, gradient = np.float32([0.7, 0.8, 0.9]), rng.standard_normal((30, 40, 3)).astype(np.float32)
    misted = add_mist(image, alpha, colour, np.empty_like(image))
    by_image, by_alpha, by_colour = mist_gradient(image, misted, alpha, colour, gradient, gradient, BufferPool())

    behind, thick, light = (sent(values).requires_grad_() for values in (image, alpha, colour))
    seen = behind_mist(behind, MistOnGPU(thick, light, thick))
    seen.backward(sent(gradient))
    assert fetched(seen) == pytest.approx(misted, abs=2e-5)
    assert fetched(behind.grad) == pytest.approx(by_image, rel=1e-3, abs=1e-3)
    there = alpha > 0  # elsewhere the GPU has none, and the kernel's is multiplied by a root of 0
    assert fetched(thick.grad)[there] == pytest.approx(by_alpha[there], rel=1e-3, abs=1e-3)
    assert fetched(light.grad) == pytest.approx(by_colour, rel=1e-3)


def test_drops_are_those_of_the_kernels(gpu):
    rng = np.random.default_rng(0)
    alpha = rng.random((12, 15)).astype(np.float32)
    light = (rng.random((12, 15, 3)) * alpha[..., None]).astype(np.float32)
    image = rng.random((30, 40, 3)).astype(np.float32)
    large = DropLayer(resized(alpha, (30, 40)), cv2.resize(light, (40, 30)))
    seen, cover = behind_drops(sent(image), sent(surroundings(image)), DropLayer(alpha, light))
    assert fetched(seen) == pytest.approx(large.forward(image, BufferPool()), abs=1e-5)
    assert fetched(cover) == pytest.approx(large.alpha, abs=1e-5)


@pytest.mark.parametrize("size", [(9, 17), (60, 80), (1, 130)])
def test_surroundings_are_those_of_the_cpu(gpu, scene, size):
    image = np.random.default_rng(0).random((*size, 3)).astype(np.float32)
    rain = RainOnGPU(RainModel(TrainingImages(panorama.eight_bit(scene)), STEPS, EAGER))
    assert fetched(rain._surroundings(sent(image))) == pytest.approx(surroundings(image), abs=1e-5)


@pytest.mark.parametrize("size", [(7, 9), (30, 40), (13, 40)])
def test_planes_become_smaller_and_larger_as_opencv_does_it(size):
    image, plane = (np.random.default_rng(0).random(shape).astype(np.float32) for shape in ((30, 40), (7, 9)))
    rows, columns = averaging(30, size[0]), averaging(40, size[1])
    assert rows @ image @ columns.T == pytest.approx(resized(image, size), abs=1e-5)
    assert enlarged(torch.from_numpy(plane)[None], size)[0].numpy() == pytest.approx(resized(plane, size), abs=1e-5)
