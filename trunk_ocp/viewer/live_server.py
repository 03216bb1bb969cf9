"""Serves the live page and its socket to this machine alone, in a thread of its own.

Two addresses exist, both with a secret token: the page, which is in memory, and the socket. What
does not come to one of them, from the page itself, and by its right name, is refused: another Host
header would be a foreign name that was made to point here, another Origin a foreign page.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import logging
import os
import secrets
import socket
import threading
from http import HTTPStatus
from typing import Any

from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.typing import Origin

from ..errors import InputError
from .live_messages import Inbox, parsed

HOST = "127.0.0.1"
PAGES = 4  # open at a time
CONNECTIONS = 16  # at a time, with those that have not said yet what they want
PATIENCE = 5.0  # s, for a connection to say it, and to end after an answer
LONGEST = 8_192  # bytes of a message
GRACE = 1.5  # s, in which a page that is loaded again comes back
LAST_WORDS = 0.2  # s, to close connections at the end
SILENT = logging.getLogger(f"{__name__}.silent")  # a refusal is nothing to report
SILENT.addHandler(logging.NullHandler())
SILENT.propagate = False


class LiveServer:
    """Serves a page from `start` to the end of a `with` block.

    Parameters
    ----------
    inbox : Inbox
        Gets the messages of the page; it is closed when the last page is.
    port : int
        0 for any that is free.

    Attributes
    ----------
    address : str
        Of the page, with the token.
    socket_address : str
        Of its socket, without.

    Raises
    ------
    InputError
        If the port is taken.
    """

    def __init__(self, inbox: Inbox, port: int = 0) -> None:
        self._inbox, self._page, self._state = inbox, b"", dict[str, Any]()
        self._listener = _listener(port)
        self._host = f"{HOST}:{self._listener.getsockname()[1]}"
        query = f"?token={secrets.token_urlsafe(32)}"
        self._page_path, self._socket_path = f"/{query}", f"/socket{query}"
        self.address = f"http://{self._host}{self._page_path}"
        self.socket_address = f"ws://{self._host}"
        self._pages: set[ServerConnection] = set()
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="live page")

    def start(self, page: str, state: dict[str, Any]) -> None:
        """Serve a page, which gets its `state` as soon as it is open."""
        self._page, self._state = page.encode(), state
        self._thread.start()

    def send(self, update: dict[str, Any]) -> None:
        """Send parts of the state to every page; called from the planner's thread."""
        self._loop.call_soon_threadsafe(self._broadcast, update, json.dumps(update))

    def __enter__(self) -> LiveServer:
        return self

    def __exit__(self, *_: object) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._ended.set)
            self._thread.join(LAST_WORDS)
        self._listener.close()

    def _broadcast(self, update: dict[str, Any], text: str) -> None:
        self._state = {**self._state, **update}  # for pages that are opened later
        broadcast(self._pages, text)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        async with serve(
            self._converse,
            sock=self._listener,
            origins=[Origin(f"http://{self._host}")],
            process_request=self._answer,
            create_connection=_counted(CONNECTIONS),
            compression=None,
            server_header=None,
            max_size=LONGEST,
            open_timeout=PATIENCE,
            close_timeout=PATIENCE,
            logger=SILENT,
        ):
            await self._ended.wait()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, or a refusal; None for the socket, whose origin is checked next."""
        method = getattr(request, "method", "GET")  # websockets before 16 refuses others itself
        if method != "GET":
            return connection.respond(HTTPStatus.METHOD_NOT_ALLOWED, "Only GET.\n")
        if request.headers.get_all("Host") != [self._host]:
            return connection.respond(HTTPStatus.FORBIDDEN, "Wrong host.\n")
        if _same(request.path, self._page_path):
            return _response(self._page)
        if not _same(request.path, self._socket_path):
            return connection.respond(HTTPStatus.FORBIDDEN, "Not this address.\n")
        if len(self._pages) >= PAGES:
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "Too many pages.\n")
        return None

    async def _converse(self, connection: ServerConnection) -> None:
        """Exchange messages with a page while it is open."""
        self._pages.add(connection)
        try:
            await connection.send(json.dumps(self._state))
            async for text in connection:
                try:
                    self._inbox.put(parsed(text))
                except InputError as error:
                    await connection.send(json.dumps({"fault": str(error)}))
        finally:
            self._pages.discard(connection)
            self._loop.call_later(GRACE, self._end_if_left)

    def _end_if_left(self) -> None:
        if not self._pages:
            self._inbox.close()


def _counted(most: int) -> type[ServerConnection]:
    """Connections of which only so many are open at a time; others are ended at once."""
    crowd: set[ServerConnection] = set()

    class Counted(ServerConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            if len(crowd) < most:
                crowd.add(self)
            else:
                self.transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            crowd.discard(self)
            super().connection_lost(exc)

    return Counted


def _listener(port: int) -> socket.socket:
    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise InputError(
            f"port {port}: cannot be used ({reason}); expected one that is free, or 0 for any."
        ) from None


def _same(path: str, expected: str) -> bool:
    """Whether a path is the expected one, compared in a time that tells nothing about it."""
    return hmac.compare_digest(path.encode(), expected.encode())


def _response(page: bytes) -> Response:
    headers = Headers(
        {
            "Content-Type": "text/html; charset=utf-8",
            "Content-Length": str(len(page)),
            "Connection": "close",
            "Cache-Control": "no-store",
            "Content-Security-Policy": "frame-ancestors 'none'",  # the rest is in the page
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
    )
    return Response(HTTPStatus.OK, "OK", headers, page)
