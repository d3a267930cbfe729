"""What a file is by its first bytes, whatever its name says."""

from pathlib import Path

BOXES = {  # brands of ISO's base media files, as of photographs and films
    b"heic": "HEIC", b"heix": "HEIC", b"hevc": "HEIC", b"heim": "HEIC", b"mif1": "HEIC", b"msf1": "HEIC",
    b"avif": "AVIF", b"avis": "AVIF", b"crx ": "a raw CR3", b"qt  ": "a film",
}  # fmt: skip
BEGINNINGS = (
    (b"\xff\xd8\xff", "JPEG"),
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"GIF8", "GIF"),
    (b"BM", "BMP"),
    (b"\xff\x0a", "JPEG XL"),
    (b"\0\0\0\x0cJXL ", "JPEG XL"),
    (b"\0\0\0\x0cjP  ", "JPEG 2000"),
    (b"v/1\x01", "OpenEXR"),
    (b"#?RADIANCE", "Radiance HDR"),
    (b"8BPS", "Photoshop"),
    (b"DDS ", "DDS"),
    (b"FUJIFILM", "a raw RAF"),
    (b"PK\x03\x04", "a zip archive"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive"),
    (b"Rar!", "a rar archive"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"%PDF", "PDF"),
    (b"<?xml", "XML"),
    (b"<!DOCTYPE", "a web page"),
    (b"<html", "a web page"),
    (b"version https://git-lfs", "a pointer of Git LFS, not the file itself"),
    (b"II*\0", "TIFF or raw"),
    (b"MM\0*", "TIFF or raw"),
)
ARCHIVES = "archive"  # in what `file_kind` says of one


def file_kind(path: Path) -> str:
    """What a file is by its first bytes, such as "HEIC"; empty where these tell nothing."""
    try:
        with path.open("rb") as file:
            start = file.read(64)
    except OSError:
        return ""
    if start[4:8] == b"ftyp":
        return BOXES.get(start[8:12], "a film")
    if start[:4] == b"RIFF" and start[8:12] == b"WEBP":
        return "WebP"
    return next((kind for beginning, kind in BEGINNINGS if start.startswith(beginning)), "")
