"""What building a data set costs: seconds a view and stage, how they grow with pixels and views, peak memory.

    python -m benchmarks dataset --capture DIR --sizes 200 400 800 --counts 20 80

Sizes are measured with the first count of views, the other counts at the first size; each case is built in a process
of its own, so that its peak memory is its own. Prints both tables, and writes them to dataset-stages.csv and
dataset-memory.csv. What Blender bakes once a variant is shared out among the views.
"""

import multiprocessing
import resource
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pandas as pd

from benchmarks.tables import report, write_csv
from hydroviews.dataset import build as build_module
from hydroviews.dataset import clean_views as build_clean
from hydroviews.dataset import rainy_variant as build_rain
from hydroviews.dataset.build import build
from hydroviews.formats.read import read_scene
from hydroviews.rain.effect import Effect
from hydroviews.rain.lens import raindrops
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import find_effect, parse_pattern, registered_effects
from hydroviews.scene.scenes import Scene, View, make_scene

COMMON = "all variants"
PATTERNS = ("raindrop-0", "raindrop-1", "raindrop-2", "streak-0", "streak-1", "streak-2")
EFFECTS: list[type[Effect]] = [type(find_effect(name)) for name in registered_effects()]
STAGES: dict[str, list[tuple[Any, str]]] = {
    "read and resize": [(View, "image")],
    "survey": [(build_module, "survey")],
    "cameras": [(build_module, "write_cameras")],
    "draw": [(effect, "draw") for effect in EFFECTS],
    "place": [(effect, "place") for effect in EFFECTS],
    "bake": [(raindrops, "bake_matte")],
    "layers": [(build_rain, "fall")],
    "composite": [(effect, "composite") for effect in EFFECTS],
    "PNG": [(build_clean, "write_png"), (build_rain, "write_png")],
    "EXR": [(build_rain, "write_layers")],
    "read clean": [(build_rain, "read_image")],
    "statistics": [(build_rain, "write_statistics")],
    "card": [(build_module, "write_card")],
    "hashes": [(build_module, "record_scene")],
}


class Stopwatch:
    """Seconds by (variant, stage); a stage within another counts for itself alone."""

    def __init__(self) -> None:
        self.seconds: defaultdict[tuple[str, str], float] = defaultdict(float)
        self.variant = COMMON
        self._inner = [0.0]  # seconds of finished stages within each that is open

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its time added to a stage of the variant that is being built."""

        def call(*arguments: Any, **options: Any) -> Any:
            self._inner.append(0.0)
            start = time.perf_counter()
            try:
                return function(*arguments, **options)
            finally:
                whole = time.perf_counter() - start
                self.seconds[self.variant, stage] += whole - self._inner.pop()
                self._inner[-1] += whole

        return call

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Time every stage of a build while the block runs."""
        write_variant = build_module.write_variant

        def variant(scene: Scene, folder: Path, pattern: Pattern, setting: Any) -> None:
            self.variant = pattern.name
            write_variant(scene, folder, pattern, setting)
            self.variant = COMMON

        with ExitStack() as stack:
            stack.enter_context(patch.object(build_module, "write_variant", variant))
            for stage, places in STAGES.items():
                for owner, name in places:
                    stack.enter_context(patch.object(owner, name, self.timed(stage, getattr(owner, name))))
            yield


def some_views(scene: Scene, count: int) -> Scene:
    """The scene with at most `count` of its views, spread evenly."""
    step = len(scene.views) / min(count, len(scene.views))
    chosen = [scene.views[int(i * step)] for i in range(min(count, len(scene.views)))]
    return make_scene(scene.name, chosen, scene.points)


def measure(capture: Path, size: int, count: int, patterns: Sequence[str]) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Build one case; rows of stages, and the case's totals and peak memory."""
    scene, rains = some_views(read_scene(capture), count), [parse_pattern(name) for name in patterns]
    watch = Stopwatch()
    with tempfile.TemporaryDirectory(prefix="hydroviews-") as scratch:
        # Compiled kernels are loaded before the clock runs.
        dry = [rain for rain in rains if not find_effect(rain.effect).needs_optics]
        build(some_views(scene, 3), Path(scratch) / "warm", patterns=dry, long_side=48)
        before = _peak_mb(resource.RUSAGE_SELF)
        start = time.perf_counter()
        with watch.watching():
            folder = build(scene, Path(scratch) / "data", patterns=rains, long_side=size)
        whole = time.perf_counter() - start
        disk = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6
    camera = scene.resized(size).views[0].camera
    case = {"size": f"{camera.width}x{camera.height}", "views": len(scene.views)}
    rest = whole - sum(watch.seconds.values())
    rows = [{**case, "variant": v, "stage": s, "seconds": t} for (v, s), t in watch.seconds.items()]
    table = pd.DataFrame([*rows, {**case, "variant": COMMON, "stage": "rest", "seconds": rest}])
    table["ms a view"] = 1000 * table["seconds"] / len(scene.views)
    table["ms a megapixel"] = 1e6 * table["ms a view"] / (camera.width * camera.height)
    memory = {
        "variants": len(rains),
        "seconds": round(whole, 1),
        "ms a view": round(1000 * whole / len(scene.views), 1),
        "MB on disk": round(disk, 1),
        "MB before": round(before),
        "peak MB": round(_peak_mb(resource.RUSAGE_SELF)),
        "peak MB of children": round(_peak_mb(resource.RUSAGE_CHILDREN)),
    }
    return table, {**case, **memory}


def _peak_mb(who: int) -> float:
    return resource.getrusage(who).ru_maxrss * 1024 / 1e6


def cases(sizes: Sequence[int], counts: Sequence[int]) -> list[tuple[int, int]]:
    """(size, views): all sizes with the first count, then the other counts at the first size."""
    return [(size, counts[0]) for size in sizes] + [(sizes[0], count) for count in counts[1:]]


def main(
    capture: Path,
    sizes: tuple[int, ...] = (200, 400, 800),
    counts: tuple[int, ...] = (20, 80),
    patterns: tuple[str, ...] = PATTERNS,
    folder: Path = Path("results/bench"),
) -> None:
    """Measure and report.

    Args:
        capture: a folder with photographs and cameras.
        sizes: pixels of the longer side.
        counts: numbers of views; more than the capture has are all of them.
        patterns: variants that are built.
        folder: where the CSV files go.
    """
    tables, totals = [], []
    for size, count in cases(sizes, counts):
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            table, total = pool.submit(measure, capture, size, count, patterns).result()
        tables.append(table)
        totals.append(total)
    stages, memory = pd.concat(tables, ignore_index=True), pd.DataFrame(totals)
    stages["case"] = stages["size"] + ", " + stages["views"].astype(str)
    order = ["variant", "stage"]
    shown = stages.pivot_table(index=order, columns="case", values="ms a view", aggfunc="sum", sort=False)
    print(f"\nmilliseconds a view\n{shown.round(2).to_string(na_rep='')}")
    report(memory, folder / "dataset-memory.csv", "per case")
    write_csv(stages.drop(columns="case"), folder / "dataset-stages.csv")
