import pytest

from baselines.distractors.delayed_growth import with_delayed_growth
from baselines.method import Method, find_method
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
    assert other.strategy.budget == one.strategy.budget
    assert other.dense_start == 0
    assert issubclass(late, method)
    assert find_method(f"{name}+delayed-growth") is late


@pytest.mark.parametrize("name", ["3dgs", "spotless"])
def test_the_order_of_wrappers_does_not_matter(name):
    one, other = (find_method(f"{name}+{order}") for order in ("enhance+delayed-growth", "delayed-growth+enhance"))
    late = one.configuration("demo")
    assert late == other.configuration("demo")
    assert late.method == find_method(f"{name}+delayed-growth").configuration("demo")
    assert late.method != find_method(f"{name}+enhance").configuration("demo").method
    with pytest.raises(InputError, match="no growth to delay"):
        find_method("nerf-w+enhance+delayed-growth").configuration("demo")


def test_what_does_not_grow_is_refused():
    with pytest.raises(InputError, match="no growth to delay"):
        find_method("nerf-w+delayed-growth").configuration("demo")
    with pytest.raises(InputError, match="no growth to delay"):
        find_method("3dgs-budget+delayed-growth").configuration("paper")
    for profile in ("demo", "standard"):  # whose pruning would be over before growth is
        with pytest.raises(InputError, match="a budget that is kept by pruning"):
            find_method("3dgs-budget+delayed-growth").configuration(profile)
    assert issubclass(with_delayed_growth(find_method("3dgs")), Method)
