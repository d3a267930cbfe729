"""Any method on clean photographs."""

from baselines.clean_wrapper import on_clean
from baselines.gaussian_splatting import GaussianSplatting
from baselines.method import find_method
from leaderboard.evaluate import needed_patterns


def test_a_method_is_shown_the_clean_views_alone():
    method = find_method("3dgs+clean")
    assert method is on_clean(GaussianSplatting)
    assert issubclass(method, GaussianSplatting)
    assert method.trains_on == "clean"
    assert GaussianSplatting.trains_on == "rainy"
    assert needed_patterns("3dgs+clean", ["streak-1", "raindrop-1"]) == ["clean"]


def test_the_references_are_such_methods():
    assert find_method("3dgs-clean") is find_method("3dgs+clean")
    assert find_method("3dgs-budget-clean") is find_method("3dgs-budget+clean")
