"""The host's side of the commands: ask, wait for the reply, ask again if it does not come."""

import os
import time
import zlib

from hdl.protocol import CONTENT_LIMIT, TABLE_VERSION, Command, Reason, tables
from model.errors import UserError
from scripts.host.chip import REGISTERS, RefusedError, other_length, parse_identity, parse_status
from scripts.host.decoder import Decoder
from scripts.host.framing import CHECK_OCTETS, frame_packet
from scripts.host.messages import Reply

__all__ = ["Commands", "NoReplyError", "table_octets"]

_HEADER = 5  # kind, sequence number, tag, command, reason; or command, tag, table, first word
#: Octets of words that fit in a TABLE, or in the reply to a READ_TABLE.
_WORDS_OCTETS = CONTENT_LIMIT - CHECK_OCTETS - _HEADER


class NoReplyError(UserError):
    """The chip does not answer."""


def _tables(words):
    """Those of all tables that ``words`` has."""
    return [table for table in tables("paper") if table.name in words]


def table_octets(table, words):
    """Words as TABLE carries them."""
    return b"".join(word.to_bytes(table.octets, "little") for word in words)


class Commands:
    """Asks the chip, one command at a time.

    A reply counts if it has the tag and the code of the command. That a packet arrived damaged is
    reported without either: it may have been this command, or noise on the line before it. So the
    reply is still waited for, though not as long, and then the command is sent again. While there
    is noise, on either line, more tries are made.

    Parameters
    ----------
    port : :class:`scripts.host.owner.PortOwner` or :class:`scripts.host.port.Port`
        What the chip is behind.
    timeout : :class:`float`
        Seconds to wait for a reply before asking again; a quarter of it after a damaged packet.
    tries : :class:`int`
        How often a command is sent, at most; four times as often while packets are damaged.
    patience : :class:`float`
        Seconds for which a chip may be busy.
    """

    def __init__(self, port, timeout=1.0, tries=5, patience=3.0):
        self.port, self.timeout, self.tries, self.patience = port, timeout, tries, patience
        self.decoder = Decoder()
        # An answer to an earlier program must not pass for one to this.
        self._tag = os.urandom(1)[0]

    def ask(self, command, data=b"", what=None, octets=None):
        """The data of the chip's reply.

        Parameters
        ----------
        command : :class:`hdl.protocol.Command`
            What to do.
        data : :class:`bytes`
            What goes with it.
        what : :class:`str` or None
            What this is in messages.
        octets : :class:`int` or None
            Length that the reply's data must have.

        Raises
        ------
        RefusedError
            If the chip refuses it.
        UserError
            If no reply comes, or one of another length.
        """
        what = what or f"the command {command.name}"
        self._tag = self._tag % 255 + 1  # never 0, the tag of replies to damaged packets
        packet = frame_packet(bytes([command, self._tag]) + data)
        unanswered, disturbed, damaged, busy_until = 0, 0, False, None
        while unanswered < self.tries and disturbed < 4 * self.tries:
            self.port.write(packet)
            noise = self._noise
            reply, reported = self._wait(command)
            if reply is None:
                damaged |= reported
                noisy = reported or self._noise > noise
                disturbed += noisy
                unanswered += not noisy
                continue
            if reply.reason == Reason.OK:
                if octets is not None and len(reply.data) != octets:
                    raise other_length(what, reply.data, octets)
                return reply.data
            repeated = unanswered + disturbed > 0
            if reply.reason != Reason.BUSY:
                raise RefusedError(what, reply.reason, repeated)
            now = time.monotonic()
            busy_until = busy_until or now + self.patience
            if now > busy_until:
                raise RefusedError(what, reply.reason, repeated)
            time.sleep(0.02)
        if damaged:
            raise RefusedError(what, Reason.DAMAGED_PACKET)
        hint = ("it sends packets, but none arrives there: is its RX wired?" if self.decoder.packets
                else "what it sends is no packet: is --baud right?" if self.decoder.octets
                else "is it powered, and is this its port?")
        raise NoReplyError(f"The chip on {self.port.name} does not answer {what}: {hint}")

    @property
    def _noise(self):
        """Counts what is damaged of what the chip sends."""
        return self.decoder.damaged + self.decoder.lost if self.decoder.packets else 0

    def _wait(self, command):
        """The reply to the last command, or None; whether the chip reported a damaged packet."""
        end, reported = time.monotonic() + self.timeout, False
        while True:
            for event in self.decoder.events(self.port.read()):
                if not isinstance(event, Reply):
                    continue
                if (event.tag, event.command) == (self._tag, command):
                    return event, reported
                if event.reason == Reason.DAMAGED_PACKET and not reported:
                    reported = True
                    end = min(end, time.monotonic() + self.timeout / 4)
            if time.monotonic() > end:
                return None, reported

    def identify(self):
        """IDENTITY_FIELDS by their names.

        Raises
        ------
        UserError
            If the chip is of another version than this program.
        """
        return parse_identity(self.ask(Command.IDENTIFY))

    def status(self):
        """STATUS_FIELDS by their names; ``state`` is a :class:`State`."""
        return parse_status(self.ask(Command.STATUS))

    def write(self, name, value, what=None):
        """Write a register, by its name; ``what`` this is in messages."""
        register = REGISTERS[name]
        self.ask(Command.WRITE, bytes([register.address])
                 + (value & 0xFFFFFFFF).to_bytes(4, "little"), what or f"{name} = {value}")

    def read(self, name):
        """The value that a register has or will have."""
        register = REGISTERS[name]
        data = self.ask(Command.READ, bytes([register.address]), f"to read {name}", 4)
        value = int.from_bytes(data, "little") & ((1 << register.bits) - 1)
        return value - (1 << register.bits) if (
            register.signed and value >> register.bits - 1) else value

    def begin(self, width, height, beams):
        """Begin a new set of tables."""
        sizes = b"".join(size.to_bytes(2, "little") for size in (width, height, beams))
        self.ask(Command.BEGIN, sizes + bytes([TABLE_VERSION]), "this calibration")

    def chunks(self, words):
        """Yield (table, first word, words), as many as fit in a packet; ``words`` by name."""
        for table in _tables(words):
            step = _WORDS_OCTETS // table.octets
            for first in range(0, len(words[table.name]), step):
                yield table, first, words[table.name][first:first + step]

    def write_table(self, table, first, words):
        """Write words that fit in a packet."""
        self.ask(Command.TABLE, bytes([table.number]) + first.to_bytes(2, "little")
                 + table_octets(table, words), f"words of the table {table.name}")

    def read_table(self, table, first, count):
        """Words of the new set."""
        data = self.ask(Command.READ_TABLE, bytes([table.number]) + first.to_bytes(2, "little")
                        + bytes([count]), f"to read the table {table.name}", count * table.octets)
        return [int.from_bytes(data[at:at + table.octets], "little")
                for at in range(0, len(data), table.octets)]

    def commit(self, words):
        """Have the chip check all tables and take them; ``words`` by the table's name."""
        data = b"".join(zlib.crc32(table_octets(table, words[table.name])).to_bytes(4, "little")
                        for table in _tables(words))
        try:
            self.ask(Command.COMMIT, data, "these tables")
        except RefusedError as refused:
            # If an answer was lost the set may be taken already.
            if not refused.repeated or refused.reason not in (Reason.NO_BEGIN, Reason.BUSY):
                raise
            state = self.status()["state"]
            if not (state.committing or state.tables_valid):
                raise

    def capture(self, milliseconds):
        """Laser without valid tables, for so long at most."""
        self.ask(Command.CAPTURE, milliseconds.to_bytes(2, "little"), "the calibration capture")

    def clear(self):
        """Forget the laser guard's causes."""
        self.ask(Command.CLEAR, what="to forget the laser guard's causes")
