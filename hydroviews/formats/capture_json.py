"""`capture.json`: how a capture was taken. All keys are optional.

rain               "captured" if it was taken in rain, else "none". There is no clean ground truth then: its
                   photographs are the one variant CAPTURED of the built scene, which has no clean views
metres_per_unit    scale of the scene, for rain in space
clean_error        mean squared error of plain 3DGS on held-out clean views over the views' mean squared fine
                   detail, for grades (see `rain.severity`)
licence            of the photographs: an SPDX identifier such as "CC-BY-4.0", or a text
shareable          true if the photographs may be handed on under that licence
drops_cost         factor by which drops that stay on the lens cost more than predicted (see `rain.severity`)
"""

import math
from pathlib import Path
from typing import Any

from hydroviews.errors import InputError
from hydroviews.files.atomic import is_there, read_json

FILE = "capture.json"
CAPTURED = "captured-0"  # the variant that rain fell on when it was photographed
RAINY = {"rain": "captured"}


def read_capture_json(folder: Path) -> dict[str, Any]:
    """The content of a capture's `capture.json`; empty where there is no file.

    Raises:
        InputError: it is not a JSON object.
    """
    path = folder / FILE
    if not is_there(path):
        return {}
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: not a capture's description", found=type(content).__name__, expected='{"rain": ...}')
    return content


def captured_rainy(folder: Path) -> bool:
    """Whether the capture was taken in rain, by its `capture.json` or by its being a CAPTURED variant.

    Raises:
        InputError: see `read_capture_json`; or its "rain" is neither "captured" nor "none".
    """
    rain = read_capture_json(folder).get("rain", "none")
    if rain not in ("captured", "none"):
        raise InputError(f"{folder / FILE}: unknown rain", found=rain, expected='"captured" or "none"')
    return bool(rain == "captured") or folder.resolve().name == CAPTURED


def described_licence(folder: Path) -> tuple[str, bool] | None:
    """The licence of a capture's photographs, and whether they may be handed on; None where it states none.

    Raises:
        InputError: see `read_capture_json`; the licence is no text, or "shareable" is neither true nor false.
    """
    content = read_capture_json(folder)
    licence, shareable = content.get("licence"), content.get("shareable", False)
    if licence is None and not shareable:
        return None
    if not (isinstance(licence, str) and licence.strip() and isinstance(shareable, bool)):
        raise InputError(
            f"{folder / FILE}: licence",
            found=f"licence {licence!r}, shareable {shareable!r}",
            expected='{"licence": "CC-BY-4.0", "shareable": true}, or false',
        )
    return licence.strip(), shareable


def described_number(folder: Path, name: str) -> float | None:
    """The positive number of that name in a capture's `capture.json`; None if there is none.

    Raises:
        InputError: see `read_capture_json`; or the value is not a positive number.
    """
    number = read_capture_json(folder).get(name)
    if number is None:
        return None
    if isinstance(number, bool) or not isinstance(number, int | float) or not (math.isfinite(number) and number > 0):
        raise InputError(f"{folder / FILE}: {name}", found=number, expected="a number above 0")
    return float(number)
