"""The web page, and what it may contact."""

import urllib.error
import urllib.request

import pytest
from mecazen.bus.ports import free_port
from mecazen_viewer.web import served_page

POLICY = "Content-Security-Policy"


@pytest.fixture(scope="module")
def page():
    data, web = free_port(), free_port()
    with served_page(data, web):
        yield f"http://127.0.0.1:{web}", data


def get(url: str):
    return urllib.request.urlopen(url, timeout=10.0)  # noqa: S310


def test_the_page_may_contact_the_viewer_and_no_other_host(page):
    address, data_port = page
    with get(f"{address}/?url=any") as answer:
        policy = dict(part.split(" ", 1) for part in answer.headers[POLICY].split("; "))
        body = answer.read().decode()
    assert policy["connect-src"] == f"'self' http://*:{data_port}"
    assert "http" not in policy["default-src"]
    assert "<title>Rerun Viewer</title>" in body
    head = body[: body.index("<style>")]
    assert "https://" not in head


def test_programs_have_their_type_and_their_size(page):
    with get(f"{page[0]}/re_viewer_bg.wasm") as answer:
        assert answer.headers["Content-Type"] == "application/wasm"
        assert len(answer.read()) == int(answer.headers["Content-Length"])


@pytest.mark.parametrize("path", ["nowhere", "%00", "@example.org/"])
def test_a_path_that_rerun_does_not_have_is_not_found(page, path):
    with pytest.raises(urllib.error.HTTPError, match="404"):
        get(f"{page[0]}/{path}")
