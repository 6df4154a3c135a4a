"""One browser that shows the page: which frame it is at, and what it was sent already."""

import asyncio
import json

from model.errors import UserError
from scripts.host.chip import check_value
from scripts.host.live_chip import ACTIONS
from scripts.view.scene import describe_frame, pack_texture

__all__ = ["Client"]

#: Seconds from one texture to the next, at least.
_TEXTURE = 0.2
#: Frames on their way to a browser that it has not drawn yet; more are left out.
_UNSEEN = 2


class Client:
    """A websocket and what its page looks at.

    A slow browser gets fewer frames, not later ones: it says which it has drawn.

    Parameters
    ----------
    session : :class:`scripts.view.session.Session`
        What is shown.
    connection : :class:`websockets.asyncio.server.ServerConnection`
        To the browser.
    """

    def __init__(self, session, connection):
        self.session, self._connection = session, connection
        self.wake, self.state_due = asyncio.Event(), True
        self._follows = session.live
        self._sent = self._textured = -1  # positions
        self._unseen = 0
        self._texture_time = 0.0
        self._listed = None

    async def greet(self):
        """The first message."""
        await self._send(self.session.hello())
        if not self._follows and self.session.history.count:
            await self._show(self.session.history.first)

    async def push(self):
        """Send what is new, as fast as the browser takes it; frames in between are left out."""
        while True:
            await self.wake.wait()
            self.wake.clear()
            history = self.session.history
            if self._follows and self._unseen < _UNSEEN and (
                    history.count and history.count - 1 != self._sent):
                self._unseen += 1
                await self._show(history.count - 1)
            measured = self.session.measurements.plain()
            if measured != self._listed:
                self._listed = measured
                await self._send({"type": "measurements", "list": measured})
            if self.state_due:
                self.state_due = False
                await self._send(self.session.state())

    async def serve(self, wish):
        """Do what the page wants; gives the result for it."""
        name, history = wish["do"], self.session.history
        if name == "frame":
            self._follows = False
            await self._show(int(wish["position"]), always=True)
            return None
        if name == "seen":
            self._unseen = max(0, self._unseen - 1)
            return None
        if name == "follow":
            self._follows, self._unseen = self.session.live, 0
            return None
        if name == "hold":
            self._follows = False
            return None
        if name == "measure":
            marks = [(float(u), float(v)) for u, v in wish["points"]]
            kind = wish["kind"]
            if kind not in ("ruler", "polyp"):
                raise ValueError
            if not history.count:
                raise UserError("There is no frame yet.")
            return await asyncio.to_thread(
                self.session.measurements.measure, int(wish["position"]), kind, marks,
                int(wish.get("frames", 1)))
        if name == "position":
            return history.position(int(wish["frame"]))
        if name == "remove":
            self.session.measurements.remove(int(wish["number"]))
            return None
        if name == "chip":
            return await self._command(wish)
        raise ValueError

    async def _command(self, wish):
        action, registers = wish["action"], wish.get("registers") or {}
        if action not in ACTIONS:
            raise ValueError
        for register, value in registers.items():
            if register not in self.session.adjustable or type(value) is not int:
                raise UserError(f"The page does not write {str(register)[:40]!r}: use `cyclope "
                                "load --register`.")
            check_value(register, value)
        if action == "set" and not registers:
            raise ValueError
        if self.session.owner is None:
            raise UserError("This is a recording: there is no chip to command.")
        return await asyncio.wrap_future(self.session.owner.do(action, registers))

    async def _show(self, position, always=False):
        history, loop = self.session.history, asyncio.get_running_loop()
        if not history.count:
            raise UserError("There is no frame yet.")
        position = min(max(position, history.first), history.count - 1)
        if position != self._sent or always:
            self._sent = position
            await self._send(describe_frame(history, position))
        now = loop.time()
        if always and position != self._textured or now - self._texture_time >= _TEXTURE:
            self._textured, self._texture_time = position, now
            await self._connection.send(pack_texture(history, position))

    async def _send(self, message):
        await self._connection.send(json.dumps(message, allow_nan=False))
