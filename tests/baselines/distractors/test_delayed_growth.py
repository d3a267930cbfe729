import pytest

from baselines.method import find_method
from baselines.splatting.config import TrainerConfig
from hydroviews.errors import InputError


@pytest.mark.parametrize("name", ["3dgs", "robust-filter", "spotless", "desplat", "wild-gaussians", "gs-w", "deraings"])
def test_every_method_of_gaussians_can_grow_late_and_does_not_unless_asked(name):
    method, late = find_method(name), find_method(f"{name}+delayed-growth")
    before, after = (kind.configuration("demo") for kind in (method, late))
    assert method.configuration("demo") == before
    assert type(after) is type(before)
    one, other = (config if isinstance(config, TrainerConfig) else config.splatting for config in (before, after))
    assert other.strategy.start == round(one.iterations / 3) > one.strategy.start
    assert other.strategy.stop == max(one.strategy.stop, round(2 * one.iterations / 3))
    assert (other.strategy.budget, other.dense_start) == (one.strategy.budget, 0)
    assert issubclass(late, method)
    assert find_method(f"{name}+delayed-growth") is late


@pytest.mark.parametrize("name", ["3dgs", "spotless"])
def test_the_order_of_wrappers_does_not_matter(name):
    one, other = (find_method(f"{name}+{order}") for order in ("enhance+delayed-growth", "delayed-growth+enhance"))
    late = one.configuration("demo")
    assert late == other.configuration("demo")
    assert late.method == find_method(f"{name}+delayed-growth").configuration("demo")
    assert late.method != find_method(f"{name}+enhance").configuration("demo").method


@pytest.mark.parametrize(
    ("name", "profile", "message"),
    [
        ("nerf-w", "demo", "no growth to delay"),
        ("nerf-w+enhance", "demo", "no growth to delay"),
        ("3dgs-budget", "paper", "no growth to delay"),
        ("3dgs-budget", "demo", "a budget that is kept by pruning"),  # which would be over before growth is
        ("3dgs-budget", "standard", "a budget that is kept by pruning"),
    ],
)
def test_what_does_not_grow_is_refused(name, profile, message):
    with pytest.raises(InputError, match=message):
        find_method(f"{name}+delayed-growth").configuration(profile)
