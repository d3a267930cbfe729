"""python -m deraings.enhancement train | export | average | validate | enhance | describe."""

from hydroviews.cli.starting import begin

if __name__ == "__main__":
    begin()

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import tyro
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from baselines.supervised import commands as supervised
from baselines.supervised.training import Validate
from baselines.supervised.validation import as_json
from baselines.supervised.weights import NetworkFiles, rounded
from baselines.training.devices import chosen_device
from deraings.enhancement.architecture.network import CONFIGS, EnhancementNetwork
from deraings.enhancement.architecture.size import describe
from deraings.enhancement.before_after import before_and_after, on_sheet
from deraings.enhancement.companions import lenses_of_companions
from deraings.enhancement.enhance import enhance
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.data import Data, described, started_from, training_pairs
from deraings.enhancement.training.pairs import Batches
from deraings.enhancement.training.training import EnhancementTraining
from deraings.enhancement.validation.calibration import draw_calibration
from deraings.enhancement.validation.pictures import LONG_SIDE, PATTERNS, validation_set
from deraings.enhancement.validation.scores import Score, as_columns, scores, scores_by_companions, table
from deraings.enhancement.weights import FILES, load_enhancer, mean_network
from hydroviews.captures.single_pictures import read_upright
from hydroviews.cli.commands import run_command
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes
from hydroviews.files.ownership import require_ours
from hydroviews.formats.photographs import one_by_one
from hydroviews.pairs.photographs import split_photographs
from hydroviews.rain.registry import parse_pattern
from hydroviews.scene.images import to_uint8, write_png
from hydroviews.scene.photograph_damage import require_whole

WATCHED = 4  # held-out photographs of the validations while training; at the end it is all of them
MOST_COMPANIONS = 35  # of a picture in validation
WATCHED_COMPANIONS = (0, 4, 12, MOST_COMPANIONS)
VALIDATION_SEED = 1000  # of the validation rain, whatever the training's seed


@dataclass(frozen=True)
class TrainingRequest(supervised.TrainingRequest):
    """A training of an enhancement network."""

    data: tyro.conf.OmitArgPrefixes[Data]
    training: tyro.conf.OmitArgPrefixes[TrainingConfig] = field(default_factory=TrainingConfig)
    # Folder of checkpoint, curve, weights and data card.
    out: Path = field(default=Path("results/enhancement/small"), kw_only=True)
    device: str = "auto"  # device of the training: auto, cpu or cuda

    files: ClassVar[NetworkFiles] = FILES

    def begin(self) -> EnhancementTraining:
        """See supervised.TrainingRequest."""
        start = started_from(self.data, self.training)
        network = start.network if start else None
        return EnhancementTraining(self.training, chosen_device(self.device), network)

    def described(self) -> str:
        """See supervised.TrainingRequest."""
        return described(self.data, started_from(self.data, self.training))

    def batches(self) -> Batches:
        """See supervised.TrainingRequest."""
        return Batches(training_pairs(self.data, self.training), self.training.batch)

    def validation(self) -> Validate:
        """See supervised.TrainingRequest: in drawn rain, alone and with companions."""
        held_out = self.data.held_out()[:WATCHED]
        watched = validation_set(held_out, VALIDATION_SEED, self.data.cache / "validation", MOST_COMPANIONS)

        def validate(network: EnhancementNetwork) -> dict[str, float]:
            alone = as_columns(scores(network, watched))
            lens = self.training.network.lens
            together = as_columns(scores(network, watched, MOST_COMPANIONS, views=0)) if lens else {}
            return alone | {f"{kind} of {MOST_COMPANIONS + 1}": value for kind, value in together.items()}

        return validate

    def judged(self, network: nn.Module) -> tuple[dict[str, Any], str]:
        """See supervised.TrainingRequest."""
        assert isinstance(network, EnhancementNetwork)
        return judged(network, self.data.held_out()[: self.validated or None], self.data.cache)


def train_command(request: tyro.conf.OmitArgPrefixes[TrainingRequest]) -> None:
    """Train a network, write its weights and data card; an interrupted command resumes when repeated."""
    supervised.train_network(request)


def export_command(request: tyro.conf.OmitArgPrefixes[TrainingRequest]) -> None:
    """Write weights and data card of an unfinished training; settings as for `train`."""
    supervised.export_network(request)


def judged(network: EnhancementNetwork, held_out: Sequence[Path], cache: Path) -> tuple[dict[str, Any], str]:
    """Scores on held-out photographs by numbers of companions: for a data card, and as tables."""
    counts = WATCHED_COMPANIONS if network.config.lens else WATCHED_COMPANIONS[:1]
    pictures = validation_set(held_out, VALIDATION_SEED, cache / "validation", counts[-1])
    rows = scores_by_companions(network, pictures, counts)
    validation = {f"{count} companions": _scores_alone(row) for count, row in rows.items()}
    return {"held out": [file.name for file in held_out], "validation": validation}, tables(rows)


def tables(rows: Mapping[int, Sequence[Score]]) -> str:
    """A Markdown table for each number of companions."""
    return "\n".join(f"\n{count} companions\n\n{table(row)}" for count, row in rows.items())


def average_command(
    weights: tyro.conf.Positional[tuple[str, ...]],
    photographs: tuple[Path, ...],
    out: Path,
    cache: Path = Path("results/enhancement/rain"),
    pictures: int = WATCHED,
) -> None:
    """Write the mean of weights, with a data card that names all of them, and validate it.

    Args:
        weights: names of shipped weights, or files; all trainings began with the same weights.
        photographs: the folders that were trained on; the held-out ones are validated on.
        out: the .safetensors file to write.
        cache: keeps what Blender bakes.
        pictures: number of held-out photographs, taken from the folders in turn; 0: all.

    Raises:
        InputError: no such weights, networks of several configurations, or files of somebody else's in the way.
    """
    require_ours([out, out.with_suffix(".json")])
    enhancers = [load_enhancer(name, "cpu") for name in weights]
    network = mean_network(enhancers)
    network.load_state_dict(rounded(network.state_dict()))
    validated, _ = judged(network, Data(photographs).held_out()[: pictures or None], cache)
    parts = [f"{enhancer.card['steps']} steps on {enhancer.card['data']}" for enhancer in enhancers]
    card = {
        "data": f"mean of {len(parts)} weights: {'; and '.join(parts)}",
        "steps": sum(enhancer.card["steps"] for enhancer in enhancers),
        **validated,
    }
    FILES.save(out, network, card)
    print(f"written: {out}, {out.stat().st_size / 1e6:.1f} MB")


def _scores_alone(rows: Sequence[Score]) -> list[dict[str, Any]]:
    """Scores for a data card, without the calibration curves."""
    return [{name: value for name, value in row.items() if name != "calibration"} for row in as_json(rows, decimals=3)]


def validate_command(
    photographs: tuple[Path, ...],
    weights: str = "small",
    cache: Path = Path("results/enhancement/rain"),
    pictures: int = 0,
    companions: tuple[int, ...] = WATCHED_COMPANIONS,
    patterns: tuple[str, ...] = (),
    families: tuple[str, ...] = (),
    side: int = LONG_SIDE,
    plot: Path | None = None,
) -> None:
    """Print the errors of weights on held-out photographs in drawn rain: covers, mist and PSNR; see `validation`.

    Args:
        photographs: the folders of the training; their held-out photographs are used.
        weights: name of shipped weights, or a file.
        cache: folder for baked lenses.
        pictures: number of photographs per folder, 0 for all.
        companions: numbers of other photographs of the lens, with one table for each.
        patterns: further rain, such as storm-1 for medium storms.
        families: further rain from the training's recipes: pane, lines, lines+pane.
        side: longer side of the pictures in pixels.
        plot: an .svg file for predicted against true errors, by kind of rain, with the most companions.

    Raises:
        InputError: no such pattern or family, an unreadable photograph, or a plot of somebody else's.
    """
    require_ours([plot] if plot else [])
    judges = [*PATTERNS, *map(parse_pattern, patterns)]
    enhancer = load_enhancer(weights)
    print(enhancer.reason)
    files = [file for folder in photographs for file in split_photographs(folder).held_out[: pictures or None]]
    kept = cache / ("validation" if side == LONG_SIDE else f"validation-{side}")
    drawn = validation_set(files, VALIDATION_SEED, kept, max(companions), judges, families, side)
    found = scores_by_companions(enhancer.network, drawn, companions)
    print(tables(found))
    if plot:
        curves = {row.kind: row.calibration for row in found[max(companions)] if row.calibration}
        write_bytes(plot, draw_calibration(curves).encode())
        print(plot)


def enhance_command(
    pictures: tyro.conf.Positional[Path],
    out: Path,
    weights: str = "small",
    keep_fog: bool = False,
    apart: bool = False,
    sheet: Path | None = None,
) -> None:
    """Remove rain from a picture or from all pictures of a folder, and write PNG files.

    Args:
        pictures: a file, or a folder of pictures from one camera, which are enhanced together.
        out: another folder.
        weights: name of shipped weights, or a file.
        keep_fog: leave mist and fog: a single picture cannot separate mist on the lens from fog.
        apart: enhance each picture of the folder alone.
        sheet: a PNG file for some pictures before and after, evenly spread in order of name.

    Raises:
        InputError: a picture that is damaged or cannot be read, a sheet that is no PNG or lies among the enhanced
            pictures, or a file of another origin that would be written over.
    """
    if sheet is not None and (sheet.suffix != ".png" or sheet.resolve().parent == out.resolve()):
        raise InputError(f"--sheet {sheet}", expected=f"a .png, not in {out}, where it would be taken for a picture")
    enhancer, targets = load_enhancer(weights), one_by_one(pictures, out)
    require_ours([*targets.values(), *([sheet] if sheet else [])])
    files = list(targets)
    require_whole(files, "looking for damage")
    print(enhancer.reason)

    def read(index: int) -> NDArray[np.uint8]:
        return to_uint8(read_upright(files[index]).image)

    lenses = [None] * len(files) if apart else lenses_of_companions(len(files), read, enhancer)
    for (file, target), lens in tqdm(list(zip(targets.items(), lenses, strict=True)), desc="enhancing", unit="picture"):
        picture = read_upright(file)
        write_png(target, enhance(picture.image, enhancer, remove_mist=not keep_fog, lens=lens), picture.alpha)
        if picture.bits > 8:
            print(f"{file}: {picture.bits} bits a channel; {target} has 8")
    if sheet is not None:
        shown = [(file.name, read_upright(file).image, read_upright(targets[file]).image) for file in on_sheet(files)]
        write_png(sheet, before_and_after("Enhancement", f"{len(shown)} of {len(files)} photographs", shown))
        print(sheet)


def describe_command(network: Literal["paper", "small"] = "small", width: int = 400, height: int = 300) -> None:
    """Print the number of parameters and multiply-adds of a network for an image size.

    Args:
        network: name of the network.
        width: image width in pixels.
        height: image height in pixels.
    """
    print(describe(CONFIGS[network], width, height))


def main() -> None:
    """Entry point."""
    run_command(
        {
            "train": train_command,
            "export": export_command,
            "average": average_command,
            "validate": validate_command,
            "enhance": enhance_command,
            "describe": describe_command,
        },
        prog="deraings.enhancement",
    )


if __name__ == "__main__":
    main()
