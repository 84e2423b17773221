"""Gate of the server: who does not have the token, comes from another page or sends too much is refused."""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlencode

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

# Nothing is loaded from elsewhere, no other page shows ours, and the address with its token is not passed on.
_HEADERS = {
    "content-security-policy": (
        "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'self'; form-action 'self'"
    ),
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
}


class TooLargeError(Exception):
    """A request whose body exceeds the limit."""


class Guard:
    """Gate around an ASGI application, for requests and websockets.

    Parameters
    ----------
    application : ASGI application
    token : str
        Secret in the address; the first request with it gets a cookie.
    port : int
        Port that the server listens on.
    largest : int
        Size of the body of a request [bytes].
    """

    def __init__(self, application: Application, token: str, port: int, largest: int) -> None:
        self._application, self._token, self._largest = application, token, largest
        self._hosts = (f"127.0.0.1:{port}", f"localhost:{port}")
        self._cookie = f"commonrail_app_{port}"  # browsers share cookies between ports

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with a refusal."""
        if scope["type"] not in ("http", "websocket"):
            await self._application(scope, receive, send)
            return
        headers = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in scope["headers"]}
        query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
        offered = query.pop("token", [""])[0]
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self._hosts or (origin is not None and origin != f"http://{host}"):
            await _refuse(scope, send, 403, "This request comes from another page.")
        elif offered and secrets.compare_digest(offered.encode(), self._token.encode()) and scope["type"] == "http":
            rest = urlencode(query, doseq=True)
            cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
            location = scope["path"] + (f"?{rest}" if rest else "")
            await _answer(send, 303, "", {"location": location, "set-cookie": cookie, "cache-control": "no-store"})
        elif not self._has_cookie(headers.get("cookie", "")):
            await _refuse(scope, send, 403, "Open the address that `commonrail app` has printed, with its token.")
        elif scope["type"] == "websocket":
            await self._application(scope, receive, send)
        else:
            await self._pass_limited(scope, receive, send, headers.get("content-length", "0"))

    def _has_cookie(self, text: str) -> bool:
        try:
            value = SimpleCookie(text).get(self._cookie)
        except CookieError:
            return False
        return value is not None and secrets.compare_digest(value.value.encode(), self._token.encode())

    async def _pass_limited(self, scope: Scope, receive: Receive, send: Send, length: str) -> None:
        """Pass on a request whose body is counted while it arrives."""
        too_large = f"A file may have {self._largest // 1_000_000} MB."
        if not length.isdecimal() or int(length) > self._largest:
            await _answer(send, 413, too_large, {"connection": "close"})
            return
        size, started = 0, False

        async def count() -> Message:
            nonlocal size
            message = await receive()
            size += len(message.get("body", b""))
            if size > self._largest:
                raise TooLargeError
            return message

        async def add_headers(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                names = {key.lower() for key, _ in message["headers"]}
                extra = [(k.encode(), v.encode()) for k, v in _HEADERS.items() if k.encode() not in names]
                message = {**message, "headers": [*message["headers"], *extra]}
            await send(message)

        try:
            await self._application(scope, count, add_headers)
        except TooLargeError:
            if not started:
                await _answer(send, 413, too_large, {"connection": "close"})


async def _refuse(scope: Scope, send: Send, status: int, sentence: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})  # before it is accepted: the handshake gets status 403
    else:
        await _answer(send, status, sentence, {})


async def _answer(send: Send, status: int, sentence: str, headers: dict[str, str]) -> None:
    pairs = {"content-type": "text/plain; charset=utf-8", **_HEADERS, **headers}
    rows = [(key.encode(), value.encode()) for key, value in pairs.items()]
    await send({"type": "http.response.start", "status": status, "headers": rows})
    await send({"type": "http.response.body", "body": sentence.encode()})
