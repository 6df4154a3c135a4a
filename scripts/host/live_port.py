"""The chip behind a port, while everything that it sends is received."""

import os
import time
from dataclasses import dataclass, field

from hdl.protocol import Command, Mode, Reason
from model.errors import UserError
from scripts.host.chip import REGISTERS, RefusedError
from scripts.host.framing import frame_packet

__all__ = ["LivePort"]

#: Seconds from asking to asking again, and how often.
_AGAIN, _TRIES = 1.0, 5


@dataclass
class _Question:
    """A command whose reply is on its way."""

    command: int
    data: bytes
    needed: str | None  # what is not possible without it
    tag: int = field(default_factory=lambda: 1 + os.urandom(1)[0] % 255)
    tries: int = 0
    due: float = 0.0

    @property
    def packet(self):
        return frame_packet(bytes([self.command, self.tag]) + self.data)


class LivePort:
    """A port to read from, and the few commands that a receiver sends; a context manager.

    The chip is asked what it is. Replies come back among what is read: :meth:`take_reply` has to
    be given them.

    Parameters
    ----------
    port : :class:`scripts.host.port.Port`
        Open.
    single : :class:`bool`
        Have the chip take a single pair of frames.
    """

    live = True

    def __init__(self, port, single=False):
        self._port = port
        self._status_asked = False
        self._questions = [_Question(Command.IDENTIFY, b"", None)]
        if single:
            self._questions.append(_Question(
                Command.WRITE,
                bytes([REGISTERS["mode"].address]) + int(Mode.SINGLE).to_bytes(4, "little"),
                "to take a single pair"))

    def __enter__(self):
        return self

    def __exit__(self, *details):
        self._port.__exit__(*details)

    def read(self):
        """Octets that came, none if none came for a short while; sends what is due.

        Raises
        ------
        UserError
            If the chip does not answer what cannot be done without.
        """
        now = time.monotonic()
        for question in [each for each in self._questions if now >= each.due]:
            if question.tries < _TRIES:
                question.tries, question.due = question.tries + 1, now + _AGAIN
                self._port.write(question.packet)
                continue
            self._questions.remove(question)
            if question.needed:
                raise UserError(f"The chip on {self._port.name} does not answer the command "
                                f"{question.needed}: is its RX wired?")
        return self._port.read()

    def ask_status(self):
        """Ask for the status, once."""
        if not self._status_asked:
            self._status_asked = True
            self._questions.append(_Question(Command.STATUS, b"", None))

    def take_reply(self, reply):
        """A reply that was read.

        Raises
        ------
        RefusedError
            If the chip refuses what cannot be done without.
        """
        for question in self._questions:
            if (question.tag, question.command) == (reply.tag, reply.command):
                if reply.reason == Reason.BUSY:
                    return
                self._questions.remove(question)
                if question.needed and reply.reason != Reason.OK:
                    raise RefusedError(question.needed, reply.reason)
                return
