"""Bounds on time and memory for hostile input, and chips that answer what they like."""

import os
import resource
import signal
import zlib
from contextlib import contextmanager

from hdl.protocol import PROTOCOL_VERSION, Command, Reason
from scripts.simulation.terminal import Terminal
from tb.link.wire import Wire

__all__ = ["GOOD", "ForgedChip", "HangError", "bounded", "forged", "identity", "status"]

#: Octets of memory that a command may take beyond what is there when it starts.
_MEMORY = 400 << 20


class HangError(BaseException):
    """Nothing in the reader catches this."""


@contextmanager
def bounded(seconds=60, memory=_MEMORY):
    """Let what runs in here have so much time and so much more memory."""
    def hang(*_):
        raise HangError(f"not done after {seconds} s")

    with open("/proc/self/statm") as numbers:
        used = int(numbers.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    limits = resource.getrlimit(resource.RLIMIT_AS)
    previous = signal.signal(signal.SIGALRM, hang)
    signal.alarm(seconds)
    resource.setrlimit(resource.RLIMIT_AS, (used + memory, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)


def identity(protocol=PROTOCOL_VERSION, tables=1, width=64, height=64, beams=16, lanes=2, preset=0,
             clock=16_000):
    """The data of a reply to IDENTIFY."""
    sizes = b"".join(size.to_bytes(2, "little") for size in (width, height, beams))
    return bytes([protocol, tables]) + sizes + bytes([lanes, preset]) + clock.to_bytes(2, "little")


def status(state=0b0000011, causes=0, rest=bytes(17)):
    """The data of a reply to STATUS."""
    return bytes([state, causes]) + rest


def _unstuffed(piece):
    out, at = b"", 0
    while at < len(piece):
        out += piece[at + 1:at + piece[at]] + b"\0"
        at += piece[at]
    return out[:-1]


class ForgedChip:
    """Answers each command by a function, over a line without noise.

    Parameters
    ----------
    answer : callable
        Given the wire, command, tag and data: octets to send.
    babble : :class:`bytes`
        Sent all the time.
    """

    def __init__(self, answer, babble=b""):
        self.answer, self.babble = answer, babble
        self.commands = 0
        self._wire, self._pending, self._out = Wire(), b"", b""

    def send(self, octets):
        """Octets from the host."""
        *pieces, self._pending = (self._pending + octets).split(b"\0")
        for piece in filter(None, pieces):
            content = _unstuffed(piece)
            body, check = content[:-4], content[-4:]
            if len(body) >= 2 and zlib.crc32(body).to_bytes(4, "little") == check:
                self.commands += 1
                self._out += self.answer(self._wire, body[0], body[1], body[2:])

    def run(self, _):
        """Time means nothing to it."""

    def receive(self):
        """Octets for the host."""
        out, self._out = self._out + self.babble, b""
        return out


@contextmanager
def forged(answers, babble=b""):
    """The path of a pseudo-terminal with a chip that gives these answers.

    Parameters
    ----------
    answers : :class:`dict` or callable
        Data of the replies by their commands, OK each; or as for :class:`ForgedChip`.
    babble : :class:`bytes`
        Sent all the time.
    """
    def answer(wire, command, tag, _):
        if command not in answers:
            return b""
        data = answers[command]
        return data(wire, tag) if callable(data) else wire.reply(tag, command, Reason.OK, data)

    chip = ForgedChip(answer if isinstance(answers, dict) else answers, babble)
    with Terminal(chip, speed=1.0) as terminal:
        yield terminal.path


#: What a chip without faults says.
GOOD = {Command.IDENTIFY: identity(), Command.STATUS: status(), Command.READ: bytes(4)}
