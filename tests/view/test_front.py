"""The page as it is sent: a result to read before the script of viser runs, and its own title."""

from __future__ import annotations

import http.client
import re
import tempfile
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.view.answer import Answer
from bumpstop.view.opened import open_source
from bumpstop.view.page.front import with_first_result
from bumpstop.view.page.server import ViewServer
from view.cases import LOWER_ARM

VISER = (
    b'<html><head><title>Viser</title><script data-p="unpacked">run</script></head>'
    b'<body><div id="root"></div></body></html>'
)


def test_the_result_stands_before_the_script_that_takes_seconds() -> None:
    answer = Answer.of(bs.load_scenario(LOWER_ARM))
    sent = with_first_result(VISER, "<cell>.toml", answer).decode()
    assert "<title>&lt;cell&gt;.toml - bumpstop</title>" in sent
    first, _, rest = sent.partition("<script data-p=")
    assert answer.sentence.split(",")[0] in first
    assert f'data-value="{answer.result.peak_force.quantile(0.99)!r}"' in first
    assert 'data-chart="distribution"' in first
    # The page of viser itself is sent as it is.
    assert rest == VISER.decode().partition("<script data-p=")[2]


def test_without_a_result_the_page_is_that_of_viser() -> None:
    sent = with_first_result(VISER, "cell", None).decode()
    assert 'id="first"' not in sent
    assert "antialias: false" in sent
    assert with_first_result(b"<html>of another version</html>", "cell", None) == b"<html>of another version</html>"


def page_of(server: ViewServer, **headers: str) -> tuple[str | None, str]:
    host, port = server.url.removeprefix("http://").split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=30)
    connection.request("GET", "/", headers=headers)
    response = connection.getresponse()
    found = response.getheader("Content-Encoding"), response.read().decode()
    connection.close()
    return found


def test_the_server_sends_the_first_result_unpacked() -> None:
    opened = open_source(str(LOWER_ARM))
    server = ViewServer(opened)
    try:
        encoding, sent = page_of(server, **{"Accept-Encoding": "gzip"})
        assert encoding == "identity"
        value = re.search(r'data-figure="peak_force_N.p99" data-value="([^"]+)"', sent)
        assert value
        assert float(value[1]) == bs.evaluate(opened.scenario).peak_force.quantile(0.99)
        assert sent.count("data-serial") == 2  # the result, and the script that takes it away
    finally:
        server.stop()


def test_a_result_that_takes_long_does_not_keep_the_page_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    import threading

    from bumpstop.view.page import server as module

    wait = threading.Event()

    def slowly(scenario: bs.Scenario) -> Answer:
        wait.wait(60)
        raise bs.InputError("x", "cannot be computed")

    monkeypatch.setattr(module.Answer, "of", slowly)
    server = ViewServer(open_source(str(LOWER_ARM)))
    try:
        assert 'id="first"' not in page_of(server)[1]
        assert not wait.is_set()
        wait.set()
        assert 'id="first"' not in page_of(server)[1]
    finally:
        wait.set()
        server.stop()


def test_a_folder_is_made_when_something_is_written_into_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    opened = open_source("sia5d")
    assert not list(tmp_path.iterdir())
    assert opened.folder == opened.folder
    assert [opened.folder] == list(tmp_path.iterdir())
