"""The host's side of the commands: ask, wait for the answer, ask again if it does not come."""

import os
import time
import zlib

from hdl.protocol import (
    CONTENT_LIMIT,
    IDENTITY_FIELDS,
    PRESET_NAMES,
    PROTOCOL_VERSION,
    STATUS_FIELDS,
    TABLE_VERSION,
    Command,
    Mode,
    Reason,
    registers,
    tables,
)
from model.errors import UserError
from scripts.host.decoder import Decoder
from scripts.host.framing import CHECK_OCTETS, frame_packet
from scripts.host.messages import Reply, fields_of

__all__ = ["REGISTERS", "SENTENCES", "Commands", "RefusedError", "State", "check_chip",
           "parse_identity", "table_octets"]

#: Registers by their names.
REGISTERS = {register.name: register for register in registers()}

#: What each reason of a refusal means, to follow "The chip refused ...: ".
SENTENCES = {
    Reason.UNKNOWN_COMMAND: "it does not know this command, so it is of another version.",
    Reason.WRONG_LENGTH: "the command has a length that it does not take, so it is of another "
                         "version.",
    Reason.UNKNOWN_REGISTER: "it does not have this register.",
    Reason.OUT_OF_RANGE: "a value or an address is outside of its limits.",
    Reason.OTHER_SENSOR: "the tables are for another sensor, another number of beams or another "
                         "version of the tables: calibrate this rig.",
    Reason.UNKNOWN_TABLE: "it does not have this table.",
    Reason.BUSY: "a set of tables still waits for its frame, or spots of a frame hold the tables; "
                 "try again, with the chip stopped if need be (`cyclope load PORT --stop`).",
    Reason.NO_BEGIN: "it forgot that a set of tables was begun (was it reset?): load again.",
    Reason.DAMAGED_TABLE: "its memory does not hold what was sent: load again, and if it stays "
                          "so, the chip is at fault.",
    Reason.NOT_STOPPED: "it has to be stopped first (`cyclope load PORT --stop`).",
    Reason.DAMAGED_PACKET: "commands arrive damaged: is the line too long or too noisy?",
}

_HEADER = 5  # kind, sequence number, tag, command, reason; or command, tag, table, first word
#: Octets of words that fit in a TABLE, or in the answer to a READ_TABLE.
_IDENTITY_OCTETS = sum(field.bits for field in IDENTITY_FIELDS) // 8
_STATUS_OCTETS = sum(field.bits for field in STATUS_FIELDS) // 8
_WORDS_OCTETS = CONTENT_LIMIT - CHECK_OCTETS - _HEADER


class RefusedError(UserError):
    """The chip refused a command; ``reason`` tells why.

    ``repeated`` if the command was sent before, so that the chip may have carried it out.
    """

    def __init__(self, what, reason, repeated=False):
        try:
            sentence = SENTENCES[Reason(reason)]
        except (ValueError, KeyError):
            sentence = f"reason {reason}, which this program does not know."
        super().__init__(f"The chip refused {what}: {sentence}")
        self.reason, self.repeated = reason, repeated


class State:
    """The octet ``state`` of STATUS, bit by bit."""

    def __init__(self, octet):
        self.tables_valid, self.armed, self.capture, self.committing = (
            bool(octet >> bit & 1) for bit in range(4))
        self.bank = octet >> 4 & 1
        self.mode = Mode(octet >> 5 & 3)
        self.silent = bool(octet >> 7)


def check_chip(identity, calibration):
    """Refuse a chip that the calibration is not for."""
    size = identity["width"], identity["height"]
    if size != (calibration.width, calibration.height):
        raise UserError(
            f"The calibration is for a sensor of {calibration.width} x {calibration.height} "
            f"pixels, the chip has one of {size[0]} x {size[1]}: calibrate this rig.")
    beams = len(calibration.settings.line)
    if identity["beams"] != beams:
        raise UserError(f"The calibration has {beams} beams, the chip is made for "
                        f"{identity['beams']}: calibrate this rig.")
    corrects = identity["preset"] == PRESET_NAMES.index("paper")
    if calibration.settings.remap and not corrects:
        raise UserError("The calibration is for a chip that corrects whole images (`cyclope "
                        "calibrate --preset paper`), which this one does not: calibrate without.")
    if corrects and not calibration.settings.remap:
        raise UserError("The chip corrects whole images, and the calibration has no table for "
                        "that: calibrate with `cyclope calibrate --preset paper`.")


def _tables(words):
    """Those of all tables that ``words`` has."""
    return [table for table in tables("paper") if table.name in words]


def table_octets(table, words):
    """Words as TABLE carries them."""
    return b"".join(word.to_bytes(table.octets, "little") for word in words)


def parse_identity(data):
    """IDENTITY_FIELDS by their names, from the answer to IDENTIFY.

    Raises
    ------
    UserError
        If the chip is of another version than this program.
    """
    version = data[0] if data else 0
    if version != PROTOCOL_VERSION or len(data) != _IDENTITY_OCTETS:
        raise UserError(f"The chip speaks version {version} of the protocol, this program version "
                        f"{PROTOCOL_VERSION}: use the program of the chip's version.")
    values = fields_of(data, IDENTITY_FIELDS)
    if values["tables"] != TABLE_VERSION:
        raise UserError(f"The chip takes tables of version {values['tables']}, this program has "
                        f"those of version {TABLE_VERSION}: use the program of the chip's version.")
    return values


class Commands:
    """Asks the chip, one command at a time.

    Parameters
    ----------
    port : :class:`scripts.host.port.Port`
        Where it is.
    timeout : :class:`float`
        Seconds to wait for an answer before asking again.
    tries : :class:`int`
        How often a command is sent, at most.
    patience : :class:`float`
        Seconds for which a chip may be busy.
    """

    def __init__(self, port, timeout=1.0, tries=5, patience=3.0):
        self.port, self.timeout, self.tries, self.patience = port, timeout, tries, patience
        self.decoder = Decoder()
        # An answer to an earlier program must not pass for one to this.
        self._tag = os.urandom(1)[0]

    def ask(self, command, data=b"", what=None):
        """The data of the chip's answer.

        Parameters
        ----------
        command : :class:`hdl.protocol.Command`
            What to do.
        data : :class:`bytes`
            What goes with it.
        what : :class:`str` or None
            What this is in messages.

        Raises
        ------
        RefusedError
            If the chip refuses it.
        UserError
            If no answer comes.
        """
        what = what or f"the command {command.name}"
        self._tag = self._tag % 255 + 1  # never 0, the tag of answers to damaged packets
        packet = frame_packet(bytes([command, self._tag]) + data)
        sent, busy_until, damaged, repeated = 0, None, False, False
        while sent < self.tries:
            self.port.write(packet)
            sent += 1
            reply = self._wait(command)
            if reply is None:
                repeated = True
                continue
            if reply.reason == Reason.OK:
                return reply.data
            if reply.reason == Reason.DAMAGED_PACKET:
                damaged = repeated = True
            elif reply.reason == Reason.BUSY:
                now = time.monotonic()
                busy_until = busy_until or now + self.patience
                if now > busy_until:
                    raise RefusedError(what, reply.reason, repeated)
                sent -= 1
                time.sleep(0.02)
            else:
                raise RefusedError(what, reply.reason, repeated)
        if damaged:
            raise RefusedError(what, Reason.DAMAGED_PACKET)
        heard = ("it sends packets, but hears nothing: is its RX wired?" if self.decoder.packets
                 else "what it sends is no packet: is --baud right?" if self.decoder.octets
                 else "is it powered, and is this its port?")
        raise UserError(f"The chip on {self.port.name} does not answer {what}: {heard}")

    def _wait(self, command):
        """The answer to the last command, or None."""
        end = time.monotonic() + self.timeout
        while True:
            for event in self.decoder.events(self.port.read()):
                if isinstance(event, Reply) and (
                        (event.tag, event.command) == (self._tag, command)
                        or event.reason == Reason.DAMAGED_PACKET):
                    return event
            if time.monotonic() > end:
                return None

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
        data = self.ask(Command.STATUS)
        if len(data) != _STATUS_OCTETS:
            raise UserError(f"The chip's status has {len(data)} octets, not {_STATUS_OCTETS}: use "
                            "the program of the chip's version.")
        values = fields_of(data, STATUS_FIELDS)
        return {**values, "state": State(values["state"])}

    def write(self, name, value):
        """Write a register, by its name."""
        register = REGISTERS[name]
        self.ask(Command.WRITE, bytes([register.address])
                 + (value & 0xFFFFFFFF).to_bytes(4, "little"), f"{name} = {value}")

    def read(self, name):
        """The value that a register has or will have."""
        register = REGISTERS[name]
        data = self.ask(Command.READ, bytes([register.address]), f"to read {name}")
        value = int.from_bytes(data, "little") & ((1 << register.bits) - 1)
        return value - (1 << register.bits) if (
            register.signed and value >> register.bits - 1) else value

    def begin(self, width, height, beams):
        """Begin a new set of tables."""
        self.ask(Command.BEGIN, width.to_bytes(2, "little") + height.to_bytes(2, "little")
                 + bytes([beams, TABLE_VERSION]), "this calibration")

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
                        + bytes([count]), f"to read the table {table.name}")
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
