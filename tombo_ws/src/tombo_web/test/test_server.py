import json
import socket

import pytest

pytest.importorskip("starlette", reason="`make live` was not run")
pytest.importorskip("httpx", reason="`make live` was not run")
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect
from test_live_session import Suite, session_of

from tombo_dynamics.errors import InputError
from tombo_web.live_page import live_page
from tombo_web.live_session import LiveSession
from tombo_web.server import Access, LiveServer, bound_socket

LOCAL = "http://127.0.0.1:8360"
STREAM = "ws://127.0.0.1:8360/stream"


def client_of(session=None, host="127.0.0.1"):
    access = Access(host, 8360, "secret")
    server = LiveServer(session or session_of(), access, "<p>page</p>")
    return TestClient(server.app, base_url=f"http://{host}:8360")


@pytest.mark.parametrize(
    ("host", "headers", "query", "status"),
    [
        ("127.0.0.1", {}, "", 200),
        ("127.0.0.1", {"host": "evil.example:8360"}, "", 403),
        ("127.0.0.1", {"origin": "http://evil.example"}, "", 403),
        ("10.0.0.7", {}, "", 403),
        ("10.0.0.7", {}, "?token=wrong", 403),
        ("10.0.0.7", {}, "?token=secret", 200),
    ],
)
def test_who_may_see_the_page(host, headers, query, status):
    with client_of(host=host) as client:
        assert client.get(f"/{query}", headers=headers).status_code == status


def test_the_stream_begins_with_hello_and_goes_on_with_frames():
    with client_of() as client, client.websocket_connect(STREAM) as stream:
        hello, frame = stream.receive_json(), stream.receive_json()
        assert (hello["kind"], frame["kind"]) == ("hello", "frame")
        assert hello["seekable"] and not hello["operable"]
        assert sum(width for _, width in hello["columns"]) == len(frame["row"])


@pytest.mark.parametrize("text", [*("", "[]", '{"do": "no"}', "[" * 4000), b"\x00"])
def test_a_bad_request_is_refused_and_the_stream_goes_on(text):
    with client_of() as client, client.websocket_connect(STREAM) as stream:
        (stream.send_bytes if isinstance(text, bytes) else stream.send_text)(text)
        kinds = [stream.receive_json()["kind"] for _ in range(8)]
        assert "refused" in kinds and kinds[-1] == "frame"


@pytest.mark.parametrize(
    ("query", "origin", "obeyed"),
    [
        ("?token=secret", LOCAL, True),
        ("?token=secret", None, False),
        ("?token=secret", "http://evil.example", False),
        ("", LOCAL, False),
        ("?token=wrong", LOCAL, False),
    ],
)
def test_only_the_page_itself_with_the_token_commands(query, origin, obeyed):
    suite = Suite()
    headers = {} if origin is None else {"origin": origin}
    with (
        client_of(LiveSession(suite, "suite", None)) as client,
        client.websocket_connect(f"{STREAM}{query}", headers=headers) as stream,
    ):
        stream.send_text(json.dumps({"do": "land"}))
        while (answer := stream.receive_json())["kind"] not in ("answer", "refused"):
            pass
    assert (answer["kind"] == "answer", suite.asked) == (obeyed, ["land"] if obeyed else [])


def test_another_page_of_the_browser_gets_no_stream():
    with client_of() as client, pytest.raises(WebSocketDisconnect):
        client.websocket_connect(STREAM, headers={"origin": "http://evil.example"}).__enter__()


def test_a_taken_port_is_named():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=rf"127\.0\.0\.1:{port}: .*accepted"):
            bound_socket("127.0.0.1", port)


def test_the_page_loads_nothing_and_its_title_is_text():
    page = live_page("<script>alert(1)</script>", {})
    assert "<script>alert(1)" not in page
    assert "src=" not in page and "http://" not in page and "https://" not in page
    assert "default-src 'none'" in page


@pytest.mark.parametrize("host", ["", "a b", "ü..x"])
def test_what_is_no_address_is_named(host):
    with pytest.raises(InputError, match=f"{host}.*accepted: an address of this machine"):
        bound_socket(host, 0)
