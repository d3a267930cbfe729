"""Words for data cards."""

from collections.abc import Mapping, Sequence
from typing import Any

from hydroviews.errors import InputError
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.rain.registry import find_effect

CAPTURED_EFFECT = CAPTURED.rpartition("-")[0]


def describe_rain(effect: str, parameters: Mapping[str, Any]) -> str:
    """The main parameters of a pattern as a phrase; all of them are in its `pattern.json`."""
    if effect == CAPTURED_EFFECT:
        return "it rained when the photographs were taken"
    try:
        words = find_effect(effect).describe(parameters)
    except InputError:  # an effect of somebody's own, which this machine need not have to describe the data
        words = ""
    return words or "see its `pattern.json`"


def how_to_open(scene: str, patterns: Sequence[str]) -> str:
    """The closing section: what the folders are for other software, and how to check them."""
    pattern = patterns[0] if patterns else "clean"
    opened = f'open_variant(Path("{scene}"), "{pattern}")' if patterns else f'open_clean(Path("{scene}"))'
    name = opened.partition("(")[0]
    added = " Clean views are in `clean`, what rain added in each variant's `layers`." if pattern != CAPTURED else ""
    return f"""## Open and check

Every variant, such as `{scene}/{pattern}`, is a COLMAP project (`images`, `sparse/0`, PINHOLE cameras) and a nerfstudio
one (`transforms.json`).{added} In Python:

```
from pathlib import Path
from hydroviews.dataset.variants import {name}
scene = {opened}
```

`hydroviews verify DIR`, with the folder that holds `manifest.json`, recomputes every hash and derives rainy
views from clean views, layers and parameters again; `hydroviews sheet DIR` draws contact sheets."""
