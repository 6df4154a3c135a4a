"""The page's server: its files, one websocket for each browser, and exports, all from here."""

import asyncio
import contextlib
import json
import mimetypes
from http import HTTPStatus
from importlib import resources
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed

from model.errors import UserError
from scripts.view.client import Client
from scripts.view.guard import Doorman

__all__ = ["PageServer"]

_SOCKET = "/socket"
#: Nothing from elsewhere is loaded or asked, and no other page may show this one.
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; "
                               "style-src 'self'; object-src 'none'; base-uri 'none'; "
                               "form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin", "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store"}
_TYPES = {".js": "text/javascript", ".html": "text/html", ".css": "text/css"}
#: Octets of a message from the browser, and messages that wait for a slow one.
_MOST, _WAITING = 1 << 16, 8


def _page_files():
    """Contents and types of the page's files, by their addresses."""
    found = {}
    for entry in (resources.files(__package__) / "page").iterdir():
        suffix = entry.name[entry.name.rfind("."):]
        if entry.is_file() and suffix in (*_TYPES, ".svg", ".txt"):
            kind = _TYPES.get(suffix) or mimetypes.guess_type(entry.name)[0] or "text/plain"
            name = "/" if entry.name == "index.html" else f"/{entry.name}"
            found[name] = entry.read_bytes(), f"{kind}; charset=utf-8"
    return found


class PageServer:
    """Serves a session; a context manager inside an event loop.

    Parameters
    ----------
    session : :class:`scripts.view.session.Session`
        What is shown.
    host : :class:`str`
        Address to listen at.
    port : :class:`int`
        Its port; 0 is a free one.

    Attributes
    ----------
    address : :class:`str`
        To be opened in a browser.
    files : :class:`dict`
        Contents and types of the page's files, by their addresses.
    """

    def __init__(self, session, host="127.0.0.1", port=0):
        self.session, self._host, self._port = session, host, port
        self.files = _page_files()
        self._clients = set()
        self._server = self._doorman = None
        self.address = None

    async def __aenter__(self):
        try:
            self._server = await serve(
                self._talk, self._host, self._port, process_request=self._request,
                max_size=_MOST, compression=None, server_header=None, open_timeout=5)
        except OSError as error:
            raise UserError(f"{self._host}:{self._port} cannot be listened at: "
                            f"{error.strerror or error}.") from error
        port = self._server.sockets[0].getsockname()[1]
        self._doorman = Doorman(self._host, port)
        shown = f"[{self._host}]" if ":" in self._host else self._host
        token = f"?token={self._doorman.token}" if self._doorman.token else ""
        self.address = f"http://{shown}:{port}/{token}"
        self._loop = asyncio.get_running_loop()
        self.session.changed = self._changed
        self._ticker = asyncio.create_task(self._tick())
        return self

    async def __aexit__(self, *_):
        self.session.changed = lambda: None
        self._ticker.cancel()
        self._server.close()
        await self._server.wait_closed()

    def _changed(self):
        """Called from the session's thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._wake)

    def _wake(self):
        for client in self._clients:
            client.wake.set()

    async def _tick(self):
        """States that change by themselves are sent at times, too."""
        while True:
            await asyncio.sleep(0.5)
            for client in self._clients:
                client.state_due = True
            self._wake()

    # Requests.

    def _request(self, connection, request):
        path = urlsplit(request.path).path
        socket = path == _SOCKET
        headers = request.headers
        try:
            host, origin = headers.get("Host"), headers.get("Origin")
        except LookupError:  # several of them
            host = origin = "several"
        reason = self._doorman.refuse(request.path, host, origin,
                                      socket or path not in self.files or path == "/", socket)
        if reason is not None:
            return self._respond(connection, HTTPStatus.FORBIDDEN, reason.encode())
        if socket:
            return None
        if path in self.files:
            return self._respond(connection, HTTPStatus.OK, *self.files[path])
        try:
            found = self.session.download(path, parse_qs(urlsplit(request.path).query))
        except UserError as error:
            return self._respond(connection, HTTPStatus.CONFLICT, str(error).encode())
        if found is None:
            return self._respond(connection, HTTPStatus.NOT_FOUND, b"There is no such page.")
        content, kind, name = found
        return self._respond(connection, HTTPStatus.OK, content, kind, name)

    def _respond(self, connection, status, content, kind="text/plain; charset=utf-8", name=None):
        response = connection.respond(status, "")
        response.body = content
        for key in ("Content-Type", "Content-Length"):
            del response.headers[key]
        response.headers["Content-Type"] = kind
        response.headers["Content-Length"] = str(len(content))
        for key, value in _HEADERS.items():
            response.headers[key] = value
        if name is not None:
            response.headers["Content-Disposition"] = f'attachment; filename="{name}"'
        return response

    async def _talk(self, connection):
        """One browser, until it goes away."""
        client = Client(self.session, connection)
        self._clients.add(client)
        pushing = asyncio.create_task(self._push(client, connection))
        try:
            await client.greet()
            async for text in connection:
                await self._answer(client, connection, text)
        except ConnectionClosed:
            pass
        finally:
            self._clients.discard(client)
            pushing.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await pushing

    async def _push(self, client, connection):
        """Send what is new; a browser that cannot be sent anything has to connect anew."""
        try:
            await client.push()
        except ConnectionClosed:
            pass
        except Exception as error:
            self.session.fault = f"A fault of the program: {type(error).__name__}: {error}."
            await connection.close(1011)

    async def _answer(self, client, connection, text):
        number = None
        try:
            wish = json.loads(text)
            if not isinstance(wish, dict):
                raise ValueError
            number = wish.get("id") if isinstance(wish.get("id"), int) else None
            result = await client.serve(wish)
        except UserError as error:
            answer = {"ok": False, "error": str(error)}
        except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
            answer = {"ok": False, "error": "This is no message of the page."}
        else:
            answer = {"ok": True, "result": result}
        if number is not None or not answer["ok"]:
            await connection.send(json.dumps({"type": "reply", "id": number, **answer}))
        if answer["ok"]:
            self._wake()
