"""Croissant metadata (MLCommons, format 1.0): what the files are, in JSON-LD that search engines and loaders read.

Akhtar et al., "Croissant: A Metadata Format for ML-Ready Datasets", 2024; https://docs.mlcommons.org/croissant/docs/.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

CROISSANT = "croissant.json"
FORMAT = "http://mlcommons.org/croissant/1.0"
PREFIX = "cr:"
TERMS = (  # of the format's usual context; others are schema.org's, such as containedIn, which 1.1 took over
    "citeAs column equivalentProperty extract field fileProperty fileObject fileSet format includes isLiveDataset "
    "jsonPath key md5 parentField path recordSet references regex repeated replace samplingRate separator source "
    "subField transform"
)
CITE = (
    "@inproceedings{liu2025deraings, title={DeRainGS: Gaussian Splatting for Enhanced Scene Reconstruction in Rainy "
    "Environments}, author={Liu, Shuhong and Chen, Xiang and Chen, Hongming and Xu, Quanfeng and Li, Mingrui}, "
    "booktitle={AAAI}, year={2025}}"
)
SPDX_ID = re.compile(r"(?=.*[-\d])[A-Za-z0-9.+-]+|MIT|Zlib|Unlicense")


@dataclass(frozen=True)
class FileFacts:
    """A file that metadata point to."""

    url: str  # relative to the metadata
    mime: str
    size: int  # bytes
    sha256: str


@dataclass(frozen=True)
class Pictures:
    """A folder of files, one a view."""

    name: str  # of the record set
    glob: str  # relative to the metadata, or to the archive's root
    mime: str
    words: str


def croissant(
    name: str,
    words: str,
    licence: str,
    version: str,
    file: FileFacts,
    folders: Collection[Pictures],
    split: Mapping[str, Collection[str]],
) -> dict[str, Any]:
    """The metadata of one packed variant.

    Args:
        name: of the variant, such as courtyard-raindrop-1.
        words: a description.
        licence: an SPDX identifier or a text.
        version: of the generator, such as 0.2.0.
        file: the archive, or the manifest where metadata lie among unpacked files.
        folders: the files of all views, a record set each.
        split: names of the "train" and "test" views.

    Returns:
        JSON-LD. Its record set `views` has name and split of every view; those of the folders have name and content.
    """
    packed = file.mime == "application/zip"
    return {
        "@context": _context(),
        "@type": "sc:Dataset",
        "name": name,
        "description": words,
        "conformsTo": FORMAT,
        "license": f"https://spdx.org/licenses/{licence}" if SPDX_ID.fullmatch(licence) else licence,
        "url": file.url,
        "version": version,
        "citeAs": CITE,
        "creator": {"@type": "sc:Organization", "name": "The HydroViews contributors"},
        "distribution": [_file_object(file), *(_file_set(one, packed) for one in folders)],
        "recordSet": [_splits(), _views(split), *map(_contents, folders)],
    }


def _context() -> dict[str, Any]:
    return {
        "@language": "en",
        "@vocab": "https://schema.org/",
        "sc": "https://schema.org/",
        "cr": "http://mlcommons.org/croissant/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "dct": "http://purl.org/dc/terms/",
        "conformsTo": "dct:conformsTo",
        "data": {"@id": "cr:data", "@type": "@json"},
        "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
        "examples": {"@id": "cr:examples", "@type": "@json"},
        **{term: PREFIX + term for term in TERMS.split()},
    }


def _file_object(file: FileFacts) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": "file",
        "name": file.url,
        "contentUrl": file.url,
        "contentSize": f"{file.size} B",
        "encodingFormat": file.mime,
        "sha256": file.sha256,
    }


def _file_set(one: Pictures, packed: bool) -> dict[str, Any]:
    return {
        "@type": "cr:FileSet",
        "@id": f"{one.name}-files",
        "name": f"{one.name}-files",
        "description": one.words,
        **({"containedIn": {"@id": "file"}} if packed else {}),
        "encodingFormat": one.mime,
        "includes": one.glob,
    }


def _splits() -> dict[str, Any]:
    rows = [("train", "cr:TrainingSplit"), ("test", "cr:TestSplit")]
    fields = [_field("splits/name", "sc:Text", "name"), _field("splits/url", "sc:URL", "what it is")]
    data = [{"splits/name": name, "splits/url": url} for name, url in rows]
    return _record_set("splits", "Training and held-out views.", fields, dataType="cr:Split", data=data)


def _views(split: Mapping[str, Collection[str]]) -> dict[str, Any]:
    part = _field("views/split", "sc:Text", "whether a method may train on it")
    part["references"] = {"field": {"@id": "splits/name"}}
    rows = sorted((name, part) for part in ("train", "test") for name in split[part])
    data = [{"views/name": name, "views/split": part} for name, part in rows]
    fields = [_field("views/name", "sc:Text", "file name without suffix"), part]
    return _record_set("views", "All views and their split.", fields, data=data)


def _contents(one: Pictures) -> dict[str, Any]:
    suffix = one.glob.rpartition(".")[2]
    kind = "sc:ImageObject" if one.mime == "image/png" else "sc:Text"
    name = _field(f"{one.name}/name", "sc:Text", "the view's, as in `views`")
    name["source"] = _extract(one, "filename", transform={"regex": rf"^(.*)\.{suffix}$"})
    content = _field(f"{one.name}/content", kind, one.words)
    content["source"] = _extract(one, "content")
    return _record_set(one.name, one.words, [name, content])


def _extract(one: Pictures, what: str, **more: Any) -> dict[str, Any]:
    return {"fileSet": {"@id": f"{one.name}-files"}, "extract": {"fileProperty": what}, **more}


def _field(name: str, kind: str, words: str) -> dict[str, Any]:
    return {"@type": "cr:Field", "@id": name, "name": name, "description": words, "dataType": kind}


def _record_set(name: str, words: str, fields: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    about = {"@type": "cr:RecordSet", "@id": name, "name": name, "description": words}
    return {**about, "key": {"@id": f"{name}/name"}, "field": fields, **more}
