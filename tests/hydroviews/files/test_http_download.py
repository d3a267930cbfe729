import base64
import hashlib
import json
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from servers import answering, serving

from hydroviews.errors import InputError
from hydroviews.files import http_download
from hydroviews.files.http_download import fetch
from hydroviews.files.ownership import FILES

pytestmark = pytest.mark.usefixtures("plain_network")

CONTENT = np.random.default_rng(0).bytes(3_000_000)
SHA = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def server():
    with serving({"/a.bin": CONTENT}) as running:
        yield running


def leftovers(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != FILES)


def begun(folder, url, part, size=3_000_000):
    """Leave a part of `a.bin` as an earlier call does."""
    (folder / "a.bin.part").write_bytes(part)
    (folder / "a.bin.part.json").write_text(json.dumps({"url": url, "size": size, "tag": None}))


OFTEN = 2 * http_download.ATTEMPTS
TWICE = {"cut_after": [1_200_000, 500_000]}


@pytest.mark.parametrize(
    ("failings", "asked"),
    [
        ({"cut_after": []}, [None]),
        (TWICE, [None, "bytes=1200000-", "bytes=1700000-"]),
        ({**TWICE, "tag": 'W/"one"'}, [None, "bytes=1200000-", "bytes=1700000-"]),
        ({"cut_after": [100_000] * OFTEN}, [None, *(f"bytes={100_000 * i}-" for i in range(1, OFTEN + 1))]),
        ({"cut_after": [2_000_000], "ranges": False}, [None, "bytes=2000000-"]),
    ],
    ids=["never", "twice", "a weak tag", "often", "no ranges"],
)
def test_a_cut_connection_is_taken_up_again(server, tmp_path, failings, asked):
    vars(server).update(failings, cut_after=[*failings["cut_after"]])
    assert fetch([f"{server.address}/a.bin"], tmp_path / "deep" / "a.bin") == SHA
    assert (tmp_path / "deep" / "a.bin").read_bytes() == CONTENT
    assert leftovers(tmp_path / "deep") == ["a.bin"]
    assert [ask[1] for ask in server.asked] == asked


@pytest.fixture
def broken_off(server, tmp_path, monkeypatch):
    """Ends a download with Ctrl-C while it waits to try again, after its connection broke; returns its address."""

    def break_off(tag='"one"'):
        server.cut_after, server.tag, url = [1_200_000], tag, f"{server.address}/a.bin"
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(http_download.time, "sleep", Mock(side_effect=KeyboardInterrupt))
            fetch([url], tmp_path / "a.bin")
        server.asked.clear()
        return url

    return break_off


def test_a_later_call_goes_on_where_an_earlier_one_ended(server, broken_off, tmp_path):
    url = broken_off()
    assert leftovers(tmp_path) == ["a.bin.part", "a.bin.part.json"]
    fetch([url], tmp_path / "a.bin")
    assert server.asked == [("/a.bin", "bytes=1200000-")]
    assert (tmp_path / "a.bin").read_bytes() == CONTENT
    assert leftovers(tmp_path) == ["a.bin"]


@pytest.mark.parametrize(
    ("before", "after", "content"),
    [('"one"', '"two"', CONTENT[::-1]), (None, None, CONTENT[::-1] + b"more")],
    ids=["another tag", "another size"],
)
def test_a_file_that_changed_in_between_is_fetched_anew(server, broken_off, tmp_path, before, after, content):
    url = broken_off(before)
    server.files["/a.bin"], server.tag = content, after
    fetch([url], tmp_path / "a.bin")
    assert (tmp_path / "a.bin").read_bytes() == content


def test_a_part_longer_than_the_file_is_dropped(server, tmp_path):
    url = f"{server.address}/a.bin"
    begun(tmp_path, url, CONTENT + b"too much", size=5_000_000)
    fetch([url], tmp_path / "a.bin")
    assert (tmp_path / "a.bin").read_bytes() == CONTENT
    assert [ask[1] for ask in server.asked] == ["bytes=3000008-", None]


UNKNOWN = ["", "{", '{"url": "http://elsewhere"}', '{"url": "HERE", "size": null, "tag": null}']


@pytest.mark.parametrize("about", UNKNOWN)
def test_a_part_of_unknown_origin_is_not_used(server, tmp_path, about):
    url = f"{server.address}/a.bin"
    (tmp_path / "a.bin.part").write_bytes(b"x" * 1000)
    if about:
        (tmp_path / "a.bin.part.json").write_text(about.replace("HERE", url))
    fetch([url], tmp_path / "a.bin")
    assert (tmp_path / "a.bin").read_bytes() == CONTENT
    if not about:  # of a browser, say
        assert (tmp_path / "a.bin.part.kept").read_bytes() == b"x" * 1000


def test_a_range_that_was_not_asked_for_is_refused(tmp_path):
    wrong = b"HTTP/1.1 206 Partial\r\nContent-Range: bytes 0-4/1005\r\nContent-Length: 5\r\n\r\nwrong"
    with answering(wrong) as address:
        begun(tmp_path, f"{address}/a.bin", CONTENT[:1000], size=1005)
        with pytest.raises(InputError, match="another range than asked for: bytes 0-4"):
            fetch([f"{address}/a.bin"], tmp_path / "a.bin")
    assert (tmp_path / "a.bin.part").read_bytes() == CONTENT[:1000]


@pytest.mark.parametrize(("sha", "asked"), [(SHA, "bytes=1200000-"), (None, None)])
def test_bytes_of_two_servers_are_joined_only_under_a_checksum(server, tmp_path, sha, asked):
    server.cut_after = [1_200_000, 0, 0, 0, 0]
    with serving({"/a.bin": CONTENT}, tag='"another"') as mirror:
        fetch([f"{server.address}/a.bin", f"{mirror.address}/a.bin"], tmp_path / "a.bin", sha)
        assert mirror.asked == [("/a.bin", asked)]
    assert (tmp_path / "a.bin").read_bytes() == CONTENT


def test_a_wrong_checksum_is_refused_and_the_next_mirror_asked(server, tmp_path):
    server.files["/bad.bin"] = b"something else"
    urls = [f"{server.address}/bad.bin", f"{server.address}/a.bin"]
    fetch(urls, tmp_path / "a.bin", SHA)
    assert (tmp_path / "a.bin").read_bytes() == CONTENT
    with pytest.raises(InputError, match=r"wrong checksum [0-9a-f]{64}, expected " + SHA):
        fetch(urls[:1], tmp_path / "b.bin", SHA)
    assert leftovers(tmp_path) == ["a.bin"]


def test_what_no_server_has_is_told_with_every_reason(server, tmp_path):
    server.status = [404, 503, 503, 503, 503]
    urls = [f"{server.address}/a.bin", f"{server.address}/a.bin?2", "http://127.0.0.1:9/a.bin"]
    with pytest.raises(InputError) as refusal:
        fetch(urls, tmp_path / "a.bin")
    faults = ("the server answered 404", "the server answered 503", "no connection")
    for said in (*(f"{url}: {fault}" for url, fault in zip(urls, faults, strict=True)), "--mirror URL"):
        assert said in str(refusal.value)
    assert len(server.asked) == 5  # 404 once, 503 four times


def test_a_disk_needs_room_for_the_rest_of_a_file(server, tmp_path, monkeypatch):
    monkeypatch.setattr(http_download.shutil, "disk_usage", lambda path: SimpleNamespace(free=1_500_000))
    url = f"{server.address}/a.bin"
    with pytest.raises(InputError, match="no space left on the disk"):
        fetch([url], tmp_path / "a.bin")
    assert "a.bin.part" not in leftovers(tmp_path)
    begun(tmp_path, url, CONTENT[:2_000_000])
    assert fetch([url], tmp_path / "a.bin") == SHA
    assert server.asked[-1] == ("/a.bin", "bytes=2000000-")


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (bytes(range(128, 256)) * 500, "the answer is not HTTP"),
        (b"\x1b[2J\x1b]0;owned\x07\r\n\r\n", "the answer is not HTTP"),
        (b"HTTP/1.1 404 \x1b[31m" + b"no" * 9000 + b"\r\n\r\n", r"the server answered 404 \\x1b"),
        (b"HTTP/1.1 302 Found\r\nLocation: http://[elsewhere\r\n\r\n", "not an address to download from"),
        (b"", "no connection"),
    ],
)
def test_what_a_server_says_is_told_briefly_and_in_print(tmp_path, answer, told):
    with answering(answer) as address, pytest.raises(InputError, match=told) as error:
        fetch([f"{address}/a.bin"], tmp_path / "a.bin")
    text = str(error.value)
    assert all(line.isprintable() for line in text.splitlines())
    assert len(text) < 1000 + len(str(tmp_path))
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("url", ["http://127.0.0.1:99999/a", "http://[127/a", "http://a..b/a", "http://127.0.0.1:x/a"])
def test_addresses_that_are_none(tmp_path, url):
    with pytest.raises(InputError, match="no server delivers it"):
        fetch([url], tmp_path / "a.bin")


def test_a_password_in_an_address_is_sent_and_neither_told_nor_kept(server, tmp_path):
    server.login = f"Basic {base64.b64encode(b'ada:secret').decode()}"
    url = f"{server.address}/a.bin"
    with pytest.raises(InputError, match="the server answered 401") as refusal:
        fetch([url.replace("//", "//ada:other-secret@")], tmp_path / "a.bin")
    assert "secret" not in str(refusal.value)
    server.cut_after = [1_200_000, 0, 0, 0]
    with pytest.raises(InputError, match="the connection ended"):
        fetch([url.replace("//", "//ada:secret@")], tmp_path / "a.bin")
    assert json.loads((tmp_path / "a.bin.part.json").read_text())["url"] == url
    fetch([url.replace("//", "//ada:secret@")], tmp_path / "a.bin")
    assert server.asked[-1] == ("/a.bin", "bytes=1200000-")


def test_a_password_does_not_follow_a_redirect(server, tmp_path):
    moved = f"HTTP/1.1 302 Found\r\nLocation: {server.address}/a.bin\r\nContent-Length: 0\r\n\r\n"
    with answering(moved.encode()) as address:
        fetch([f"{address}/a.bin".replace("//", "//ada:secret@")], tmp_path / "a.bin")
    assert server.logins == [None]
