"""What the enhancement network does to photographs of real rain, of which nobody has a clean one.

    python -m benchmarks.real_rain --rainy FOLDER --dry FOLDER --out results/bench/real-rain

Each photograph is enhanced alone. What can be counted without the truth: how much streaks and drops cover of a
photograph as the network sees it, in rain and when it is dry; how often a rainy one has more than a dry one (the area
under the ROC curve: 0.5 if it cannot tell); and how much it alters either. Writes real_rain.csv, and before-after.png
with rainy photographs evenly spread in order of name, so that nobody has chosen them by their looks.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import mannwhitneyu
from tqdm import tqdm

from baselines.training.torch_state import one_thread
from deraings.enhancement.before_after import before_and_after, on_sheet
from deraings.enhancement.clear_pixels import DROPS, STREAKS
from deraings.enhancement.enhance import predict
from deraings.enhancement.weights import DEFAULT, load_enhancer
from hydroviews.cli.commands import run_command
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.scene.images import Image, list_images, read_image, write_png

COLUMNS = ("streaks", "drops", "altered")  # what is counted of a photograph


def counted(photograph: Image, enhanced: Image, cover: Image) -> tuple[float, ...]:
    """What streaks and drops cover of a photograph, and by how much it is altered (root mean square).

    Args:
        photograph: [H, W, 3].
        enhanced: the same, enhanced.
        cover: what rain covers of it [H, W, 3], see `predict`.
    """
    covers = cover.mean(axis=(0, 1))
    return float(covers[STREAKS]), float(covers[DROPS]), float(np.sqrt(np.mean((enhanced - photograph) ** 2)))


def summary(photographs: pd.DataFrame, kinds: Sequence[str]) -> pd.DataFrame:
    """Medians and quartiles by kind, and how often a photograph of the first kind has more than one of the second."""
    rows = []
    for column in COLUMNS:
        first, second = (photographs.loc[photographs["kind"] == kind, column] for kind in kinds)
        quartiles = [values.quantile(share).round(3) for values in (first, second) for share in (0.25, 0.5, 0.75)]
        more = mannwhitneyu(first, second).statistic / (len(first) * len(second))
        rows.append((column, *quartiles, round(float(more), 2)))
    named = [f"{kind}, {share}" for kind in kinds for share in ("lower quartile", "median", "upper quartile")]
    return pd.DataFrame(rows, columns=["of a photograph", *named, "more in the first"])


def main(rainy: Path, dry: Path, out: Path = Path("results/bench/real-rain"), weights: str = DEFAULT) -> None:
    """Enhance all photographs and report.

    Args:
        rainy: folder of photographs taken in rain.
        dry: folder of others.
        out: gets table and picture.
        weights: shipped ones, or a file.

    Raises:
        InputError: no such weights, or a photograph that cannot be read.
    """
    enhancer, files = load_enhancer(weights), {"rainy": list_images(rainy), "dry": list_images(dry)}
    shown = set(on_sheet(files["rainy"]))
    rows, pictures = [], []
    with one_thread():
        for kind, of_kind in files.items():
            for file in tqdm(of_kind, desc=kind, unit="photograph"):
                photograph = read_image(file)
                enhanced = predict(photograph, enhancer)
                if enhanced.cover is None:
                    raise InputError(f"{weights}: a network that does not predict covers", expected="one with `alpha`")
                rows.append((kind, file.name, *counted(photograph, enhanced.picture, enhanced.cover)))
                if file in shown:
                    pictures.append((file.name, photograph, enhanced.picture))
    found = pd.DataFrame(rows, columns=["kind", "photograph", *COLUMNS])
    write_bytes(out / "real_rain.csv", found.to_csv(index=False).encode())
    remark = f"{len(pictures)} of {len(files['rainy'])}"
    write_png(out / "before-after.png", before_and_after("Real rain", remark, pictures))
    print(summary(found, list(files)).to_string(index=False))


if __name__ == "__main__":
    run_command(main, prog="benchmarks.real_rain")
