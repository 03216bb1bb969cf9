"""The server of the live page, attacked: whatever is not the page or its socket is refused."""

import contextlib
import http.client
import json
import socket
import time
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import connect

from trunk_ocp.errors import InputError
from trunk_ocp.viewer import live_server
from trunk_ocp.viewer.live_messages import Inbox
from trunk_ocp.viewer.live_server import CONNECTIONS, PAGES, LiveServer

PAGE = "<!DOCTYPE html><title>page</title>" + 1_000_000 * "x"
STATE = {"status": {"text": "as it opens"}}
CHANGE = '{"n": 1, "reset": true}'


@pytest.fixture(scope="module")
def inbox():
    return Inbox()


@pytest.fixture(scope="module")
def server(inbox):
    """A server with one page open, which says nothing."""
    with pytest.MonkeyPatch.context() as patch, LiveServer(inbox) as running:
        patch.setattr(live_server, "PATIENCE", 1.0)
        running.start(PAGE, STATE)
        with talking(running):
            yield running


@pytest.fixture(autouse=True)
def alive(server):
    """After every attack the page and its socket work as before."""
    yield
    until(lambda: answer(server)[0] == 200)  # idle connections are gone
    assert answer(server)[2].decode() == PAGE
    with talking(server) as page:
        assert "status" in json.loads(page.recv())


def until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def parts(server):
    """Host with port, and the page's path with the token."""
    split = urlsplit(server.address)
    return split.netloc, f"{split.path}?{split.query}"


def talking(server, path=None, origin=None, host=None, **options):
    """A page's socket."""
    netloc, query = parts(server)
    address = f"ws://{host or netloc}/socket{query[1:]}" if path is None else f"ws://{netloc}{path}"
    options = {"origin": origin or f"http://{netloc}", "open_timeout": 5, **options}
    return connect(address, proxy=None, sock=socket.create_connection(_endpoint(netloc)), **options)


def _endpoint(netloc):
    host, port = netloc.split(":")
    return host, int(port)


def sent(server, data, read=True):
    """The first line of what comes back for raw bytes; empty if the connection just ends."""
    with socket.create_connection(_endpoint(parts(server)[0]), timeout=10) as raw:
        with contextlib.suppress(ConnectionError):
            raw.sendall(data)
        with contextlib.suppress(ConnectionError):
            return raw.recv(4096).split(b"\r\n")[0].decode() if read else ""
    return ""


def answer(server, path=None, method="GET", body=None, **headers):
    """Status, headers and body of a request; (0, {}, b"") if there is none."""
    netloc, own = parts(server)
    connection = http.client.HTTPConnection(netloc, timeout=10)
    try:
        connection.request(method, own if path is None else path, body, headers)
        response = connection.getresponse()
        return response.status, dict(response.headers), response.read()
    except (ConnectionError, http.client.HTTPException):
        return 0, {}, b""
    finally:
        connection.close()


def refused(status):
    return status == 0 or 400 <= status < 600


def test_it_listens_on_this_machine_alone(server):
    assert server._listener.getsockname()[0] == "127.0.0.1"
    with pytest.raises(InputError, match="cannot be used"):
        LiveServer(Inbox(), server._listener.getsockname()[1])


def test_the_page_is_for_no_cache_no_frame_and_no_other_site(server):
    status, headers, body = answer(server)
    assert (status, body.decode()) == (200, PAGE)
    assert headers["Cache-Control"] == "no-store"
    assert headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"


def test_without_the_token_there_is_nothing(server):
    _, own = parts(server)
    token = own.partition("=")[2]
    wrong = token[:-1] + ("A" if token[-1] != "A" else "B")
    paths = ["/", "/?token=", f"/?token={wrong}", f"/?token={token}x", f"/?token={token[:-1]}"]
    paths += [f"/?token={token}&token={wrong}", f"/?TOKEN={token}", f"/index.html?token={token}"]
    paths += [f"//?token={token}", f"/%2e%2e/?token={token}", f"/../../etc/passwd?token={token}"]
    paths += [f"/socket/../?token={token}", f"/?token={token}#x", f"http://evil/?token={token}"]
    paths += ["/etc/passwd", "/favicon.ico", "*", f"/?token={token}%00", "/" + 20_000 * "a"]
    assert {
        path: answer(server, path)[0] for path in paths if not refused(answer(server, path)[0])
    } == {}
    for path in ("/socket", f"/socket?token={wrong}", f"/other?token={token}", f"/?token={token}"):
        with pytest.raises((InvalidHandshake, ConnectionError)):
            talking(server, path)


def test_other_hosts_and_origins_are_refused(server):
    netloc, _ = parts(server)
    port = netloc.partition(":")[2]
    for host in ("evil.example", f"evil.example:{port}", f"localhost:{port}", "127.0.0.1", ""):
        assert answer(server, Host=host)[0] == 403, host
    _, path = parts(server)
    for hosts in ("", f"Host: {netloc}\r\nHost: evil.example\r\n"):
        line = sent(server, f"GET {path} HTTP/1.1\r\n{hosts}\r\n".encode())
        assert " 200 " not in line
    for origin in ("http://evil.example", "null", f"http://localhost:{port}", f"https://{netloc}"):
        with pytest.raises(InvalidHandshake):
            talking(server, origin=origin)
    with pytest.raises(InvalidHandshake):
        talking(server, origin=f"http://{netloc}", additional_headers={"Origin": "http://evil"})
    with pytest.raises(InvalidHandshake):
        talking(server, host=f"evil.example:{port}")


@pytest.mark.parametrize("method", ["POST", "PUT", "HEAD", "OPTIONS", "DELETE", "TRACE", "BREW"])
def test_other_methods_are_refused(server, method):
    assert refused(answer(server, method=method)[0])


def test_bodies_are_refused(server):
    large = 10_000_000 * b"x"
    assert refused(answer(server, method="POST", body=large)[0])
    assert refused(answer(server, body=large)[0])
    netloc, path = parts(server)
    chunked = (
        f"GET {path} HTTP/1.1\r\nHost: {netloc}\r\nTransfer-Encoding: chunked\r\n\r\n".encode()
    )
    assert " 200 " not in sent(server, chunked + b"5\r\nhello\r\n0\r\n\r\n")
    assert " 200 " not in sent(server, f"GET {path} HTTP/1.1\r\nX: ".encode() + large)
    assert " 200 " not in sent(server, large)
    assert " 200 " not in sent(server, b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03")  # TLS


def test_messages_that_are_too_long_end_their_connection(server, inbox):
    for message in (10_000_000 * "x", 10_000_000 * b"x"):
        with talking(server) as page:
            page.recv()
            with contextlib.suppress(ConnectionClosed):
                page.send(message)
            with pytest.raises(ConnectionClosed):
                page.recv(timeout=10)
    assert not inbox.waiting


def test_garbage_is_answered_with_a_sentence(server, inbox):
    with talking(server) as page:
        page.recv()
        for message in ("", "{", "[]", b"\x00\xff", '{"n": "1"}', 3000 * "[", '{"n": 1, "x": 2}'):
            page.send(message)
            assert json.loads(page.recv(timeout=10))["fault"].startswith("message:")
        assert not inbox.waiting
        page.send(CHANGE)
        assert [message.reset for message in inbox.take()] == [True]


def test_a_hundred_connections_and_pages_are_too_many(server):
    endpoint = _endpoint(parts(server)[0])
    with talking(server) as page, contextlib.ExitStack() as stack:
        page.recv()
        idle = [stack.enter_context(socket.create_connection(endpoint)) for _ in range(100)]
        ended = 0
        for raw in idle:  # those above the limit end at once, the others when their time is up
            raw.settimeout(0.1)
            with contextlib.suppress(TimeoutError):
                ended += not _received(raw)
        assert ended >= 100 - CONNECTIONS
        page.send("{")
        assert "fault" in json.loads(page.recv(timeout=10))
    with contextlib.ExitStack() as stack:
        until(lambda: answer(server)[0] == 200)
        for _ in range(PAGES - 1):  # with that of the fixture
            stack.enter_context(talking(server)).recv()
        with pytest.raises(InvalidHandshake):
            talking(server)


def _received(raw):
    with contextlib.suppress(ConnectionError):
        return raw.recv(1)
    return b""


def test_every_page_gets_what_is_sent_and_a_later_one_the_whole_state(server):
    with talking(server) as one, talking(server) as other:
        for page in (one, other):
            page.recv()
        server.send({"fault": "a sentence"})
        for page in (one, other):
            assert json.loads(page.recv(timeout=10)) == {"fault": "a sentence"}
        with talking(server) as later:
            assert json.loads(later.recv()) == {**STATE, "fault": "a sentence"}


def test_the_conversation_ends_when_the_last_page_is_closed_and_does_not_come_back():
    inbox = Inbox()
    with LiveServer(inbox) as server:
        server.start(PAGE, STATE)
        with talking(server) as page:
            page.recv()
        with talking(server) as again:  # the page was loaded again
            again.recv()
            assert not inbox.wait(2.0)
        assert inbox.wait(10.0)
        assert inbox.take() == []
