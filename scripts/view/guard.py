"""Who may have the page: nobody from another machine without its token, and no foreign page."""

import hmac
import secrets
from urllib.parse import parse_qs, urlsplit

__all__ = ["Doorman"]

_LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class Doorman:
    """Decides on requests by their headers.

    A page of another site can send requests to this machine, and open websockets: the browser
    then says where that page is from, in ``Origin``, and a name that leads here by a trick is in
    ``Host``. Both are checked. On other addresses than this machine's own a token is needed too.

    Parameters
    ----------
    host : :class:`str`
        Address that is listened at.
    port : :class:`int`
        Its port.

    Attributes
    ----------
    token : :class:`str` or None
        Part of the page's address, where it is needed.
    """

    def __init__(self, host, port):
        self.port, self._local = port, host in ("127.0.0.1", "::1", "localhost")
        self.token = None if self._local else secrets.token_urlsafe(16)

    def refuse(self, path, host, origin, guarded, socket=False):
        """Why a request is refused, in a sentence; None if it is not.

        Parameters
        ----------
        path : :class:`str`
            With its query.
        host, origin : :class:`str` or None
            Headers.
        guarded : :class:`bool`
            The token is needed for it, if there is one.
        socket : :class:`bool`
            A websocket, for which browsers always send an origin.
        """
        name = (host or "").lower()
        if self._local and name not in {f"{each}:{self.port}" for each in _LOOPBACK}:
            return "This page is for this machine only: open it by the address that was printed."
        if socket and origin is None:
            return "Only the page itself may connect."
        if origin is not None and origin.lower() != f"http://{name}":
            return "Another page may not connect."
        if guarded and self.token is not None:
            given = parse_qs(urlsplit(path).query).get("token", [""])[0]
            if not hmac.compare_digest(given.encode(), self.token.encode()):
                return "The address needs its token: open it as it was printed."
        return None
