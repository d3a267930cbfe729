import sys
from pathlib import Path

import pytest

# Not tests/ itself: it has folders named like the packages.
sys.path.insert(0, str(Path(__file__).parent / "helpers"))


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="run the tests that take minutes too")


def pytest_collection_modifyitems(config, items):
    if not config.getoption("--slow"):
        for item in items:
            if item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.skip(reason="takes minutes; run it with --slow"))
