"""What the chip does with the host's commands: octets in, replies and new state out."""

from hdl.protocol import (
    CONTENT_LIMIT,
    IDENTITY_FIELDS,
    PRESET_NAMES,
    PROTOCOL_VERSION,
    STATUS_FIELDS,
    TABLE_VERSION,
    Command,
    Mode,
    PacketKind,
    Reason,
    registers,
)

from .receiver import PacketReceiver
from .reply_fields import field_octets
from .table_access import TableStore

__all__ = ["CommandMachine", "Refused"]

#: Octets of parameters.
_LENGTHS = {
    Command.IDENTIFY: 0, Command.WRITE: 5, Command.READ: 1, Command.BEGIN: 7,
    Command.READ_TABLE: 4, Command.STATUS: 0, Command.CAPTURE: 2, Command.CLEAR: 0,
}
_DATA_LIMIT = CONTENT_LIMIT - 9


class Refused(Exception):  # noqa: N818
    """Raised by a command that is refused; ``args[0]`` is the :class:`Reason`."""


def _number(octets):
    return int.from_bytes(octets, "little")


class CommandMachine:
    """The state that the host sees, changed by the octets that it sends.

    Attributes
    ----------
    written, acting : dict of int by register
        Values as they were written, and as they act.
    tables : :class:`model.link.table_access.TableStore`
        The words of all tables.
    tables_valid, begun, committed : bool
        Whether the bank that acts was checked; whether BEGIN opened a new set; whether that waits
        for its frame.
    capture : int
        Milliseconds that the last CAPTURE gave.
    cleared : int
        How often CLEAR came.
    ready : bool
        Whether no spot needs the tables.
    status : dict of int
        What STATUS reports from other blocks, by field; ``state`` holds only their bits.
    """

    def __init__(self, width, height, beams, lanes, preset="capsule", clock_hz=16_000_000,
                 baud=115_200, versions=(PROTOCOL_VERSION, TABLE_VERSION)):
        self.registers = {register.address: register for register in registers(clock_hz, baud)}
        self.written = {entry.name: entry.reset for entry in self.registers.values()}
        self.acting = dict(self.written)
        self._mode_written = False
        self.tables = TableStore(preset, beams, width * height)
        self.kinds, self.counts = self.tables.kinds, self.tables.counts
        self.tables_valid = self.begun = self.committed = False
        self.capture = self.cleared = 0
        self.ready = True
        self.status = {field.name: 0 for field in STATUS_FIELDS}
        protocol, table_version = versions
        self._sensor = (width, height, beams, table_version)
        self._identity = {
            "protocol": protocol, "tables": table_version, "width": width,
            "height": height, "beams": beams, "lanes": lanes,
            "preset": PRESET_NAMES.index(preset),
            "clock_khz": clock_hz // 1000}
        self._receiver = PacketReceiver()

    @property
    def bank(self):
        """Bank of the tables that acts."""
        return self.tables.bank

    def checks(self):
        """The CRC-32 of each table of the new set."""
        return self.tables.checks()

    # From the rest of the chip.

    def hand_over(self):
        """A frame starts without spots of an older one, or the chip is idle and stopped."""
        self.acting = dict(self.written)
        self._mode_written = False
        if self.committed:
            self.tables.swap()
            self.tables_valid, self.committed = True, False

    def single_done(self):
        """The single pair was exposed."""
        if self.acting["mode"] == Mode.SINGLE:
            self.acting["mode"] = int(Mode.STOP)
            if not self._mode_written:
                self.written["mode"] = int(Mode.STOP)

    # From the host.

    def receive(self, octets):
        """Replies (contents of packets, without sequence number) to octets on the line."""
        replies = []
        for octet in octets:
            content = self._receiver.receive(octet)
            if content is False:
                self._count("damaged")
                replies.append(bytes([PacketKind.REPLY, 0, 0, Reason.DAMAGED_PACKET]))
            elif content:
                replies.append(self.reply(content))
        return replies

    def reply(self, content):
        """Reply to the content of a packet that passed its check."""
        command, tag, parameters = content[0], content[1], content[2:]
        reason, data = Reason.OK, b""
        try:
            data = self._carry_out(command, parameters)
        except Refused as refused:
            reason = refused.args[0]
        self._count("refused" if reason else "accepted")
        return bytes([PacketKind.REPLY, tag, command, reason]) + data

    def _count(self, name):
        self.status[name] = min(self.status[name] + 1, 0xFFFF)

    def _carry_out(self, command, parameters):
        try:
            command = Command(command)
        except ValueError:
            raise Refused(Reason.UNKNOWN_COMMAND) from None
        lengths = {**_LENGTHS, Command.COMMIT: 4 * len(self.kinds)}
        if len(parameters) != lengths.get(command, len(parameters)) or (
                command == Command.TABLE and len(parameters) < 4):
            raise Refused(Reason.WRONG_LENGTH)
        return getattr(self, "_" + command.name.lower())(parameters) or b""

    def _identify(self, _):
        return field_octets(IDENTITY_FIELDS, self._identity)

    def _status(self, _):
        mine = (self.tables_valid | bool(self.capture) << 2 | self.committed << 3 | self.bank << 4
                | self.acting["mode"] << 5)
        values = {**self.status, "state": self.status["state"] | mine}
        return field_octets(STATUS_FIELDS, values)

    def _register(self, address):
        if address not in self.registers:
            raise Refused(Reason.UNKNOWN_REGISTER)
        return self.registers[address]

    def _write(self, parameters):
        register = self._register(parameters[0])
        value = int.from_bytes(parameters[1:], "little", signed=register.signed)
        low, high = register.low, register.high
        if register.signed:
            low, high = -(1 << register.bits - 1), (1 << register.bits - 1) - 1
        elif high is None:
            high = (1 << register.bits) - 1
        if not low <= value <= high:
            raise Refused(Reason.OUT_OF_RANGE)
        if register.only_stopped and self.acting["mode"] != Mode.STOP:
            raise Refused(Reason.NOT_STOPPED)
        self.written[register.name] = value
        self._mode_written = self._mode_written or register.name == "mode"

    def _read(self, parameters):
        register = self._register(parameters[0])
        return self.written[register.name].to_bytes(4, "little", signed=register.signed)

    def _begin(self, parameters):
        sensor = (*(_number(parameters[at:at + 2]) for at in (0, 2, 4)), parameters[6])
        if sensor != self._sensor:
            raise Refused(Reason.OTHER_SENSOR)
        if self.committed:
            raise Refused(Reason.BUSY)
        self.begun = True

    def _require(self, number, first, count):
        """Refuse words that a table does not have, or that may not be accessed now."""
        if not count or first + count > self.counts[number]:
            raise Refused(Reason.OUT_OF_RANGE)
        if self.committed or not self.ready:
            raise Refused(Reason.BUSY)

    def _table(self, parameters):
        number, first, octets = parameters[0], _number(parameters[1:3]), parameters[3:]
        if number >= len(self.kinds):
            raise Refused(Reason.UNKNOWN_TABLE)
        table = self.kinds[number]
        count, rest = divmod(len(octets), table.octets)
        if rest:
            raise Refused(Reason.WRONG_LENGTH)
        self._require(number, first, count)
        if not self.begun:
            raise Refused(Reason.NO_BEGIN)
        if not table.banked:
            if self.acting["mode"] != Mode.STOP:
                raise Refused(Reason.NOT_STOPPED)
            self.tables_valid = False
        for index in range(count):
            word = octets[table.octets * index:table.octets * (index + 1)]
            self.tables.write(number, first + index, _number(word))

    def _read_table(self, parameters):
        number, first, count = parameters[0], _number(parameters[1:3]), parameters[3]
        if number >= len(self.kinds):
            raise Refused(Reason.UNKNOWN_TABLE)
        if count * self.kinds[number].octets > _DATA_LIMIT:
            raise Refused(Reason.OUT_OF_RANGE)
        self._require(number, first, count)
        return self.tables.octets(number, first, count)

    def _commit(self, parameters):
        if self.committed or not self.ready:
            raise Refused(Reason.BUSY)
        if not self.begun:
            raise Refused(Reason.NO_BEGIN)
        given = [_number(parameters[at:at + 4]) for at in range(0, len(parameters), 4)]
        if given != self.checks():
            raise Refused(Reason.DAMAGED_TABLE)
        self.committed, self.begun = True, False

    def _capture(self, parameters):
        self.capture = _number(parameters)

    def _clear(self, _):
        self.cleared += 1
