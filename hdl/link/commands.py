"""Carries out the host's commands, and replies."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import MemoryCommand, PacketOctet
from ..ports import TABLE_PORT
from ..protocol import (
    CONTENT_LIMIT,
    MOST_BEAMS,
    PRESET_NAMES,
    SENSOR_PIXELS,
    TABLE_VERSION,
    Command,
    Mode,
    PacketKind,
    Reason,
    tables,
)
from .capture_timer import CaptureTimer
from .receiver import CRC
from .registers import Registers, register_members
from .reply_fields import ReplyFields, status_ports
from .table_access import TableAccess

__all__ = ["Commands"]

_CRC_OCTETS = 4
#: Octets of a reply's content before its data, sequence number included.
_REPLY_HEAD = 5
#: Octets of data that a reply may have.
_DATA_LIMIT = CONTENT_LIMIT - _CRC_OCTETS - _REPLY_HEAD
#: Octets of a TABLE before its words.
_TABLE_HEAD = 5
#: Octets of each command; TABLE takes more than this.
_LENGTHS = {
    Command.IDENTIFY: 2, Command.WRITE: 7, Command.READ: 3, Command.BEGIN: 9,
    Command.TABLE: _TABLE_HEAD,
    Command.READ_TABLE: 6, Command.STATUS: 2, Command.CAPTURE: 4, Command.CLEAR: 2,
}
_PARAMETERS = 7  # octets that are looked at together
#: Fields of the status that are counted here.
_COUNTERS = ("accepted", "refused", "damaged", "framing")


class _Shared:
    """What the stages of the state machine share."""

    def __init__(self, tables, counts, access, fields, registers, crc):
        self.access, self.fields, self.registers, self.crc = access, fields, registers, crc

        # The packet: the octet of the buffer that is looked at, whether the buffer shows it, and
        # the packet's parameters or a word of a table, with the octet of that, one hot.
        self.command = Signal(Command)
        self.position = Signal(7)
        self.data_valid = Signal()
        self.word = Signal(72, reset_less=True)
        self.octet_select = Signal(9, init=1)

        # The reply: where its data end, and the octet that comes next.
        self.reason = Signal(Reason)
        self.last_position = Signal(7)
        self.answers_damage = Signal()
        self.octet = Signal(8)
        self.replied = Signal()

        # The words of a table that a command is about.
        most = max(counts)
        self.select = Signal(range(len(tables)))
        self.word_index = Signal(range(most))
        self.words_left = Signal(8)
        self.octets_left = Signal(7)
        self.first = self.word[8:24]
        self.last_octet = Signal()
        self.last_word = Signal()

        # The table itself: octets of a word, words, the most of them in a reply, banks.
        self.octets = Signal(4)
        self.words = Signal(range(most + 1))
        self.most = Signal(8)
        self.banked = Signal()

        # The set of tables: open for words; or committed, to act with the next pattern frame.
        self.begun = Signal()
        self.committed = Signal()
        self.stopped = Signal()

    def go_to(self, position):
        """Statements that look at another octet of the buffer."""
        return [self.position.eq(position), self.data_valid.eq(0)]

    def refuse(self, m, reason):
        """Go to the reply, with a reason."""
        m.d.sync += self.reason.eq(reason)
        m.next = "REPLY"


class Commands(wiring.Component):
    """Carries out the host's commands, one at a time, and replies to each.

    This state machine replaces the paper's soft processor. It works through the receiver's buffer
    octet by octet. Each packet gets one reply; a refused command changes nothing. A damaged packet
    gets one too, in which command and tag are zero; damage during a reply shares the next one. The
    buffer is released when the reply's last octet was taken: the host waits for each reply.
    ``hdl/link/README.md`` has commands, registers, tables and the order of the checks.

    A register is written at once, and acts from the clock after ``apply``, together with all
    others; while ``mode`` is stop and ``idle`` is high, from the end of its command. ``stop``
    reports a written stop at once, whatever the line and the spots are waiting for. A set of tables
    that was committed is swapped with the old one then too, and ``tables_valid`` rises.

    Host accesses to the tables go to bank ``~bank``, where there are two, while ``table_ready`` is
    high, one in four clocks or fewer, see :class:`.table_access.TableAccess`. COMMIT reads every
    word of a set once for each of its octets, and takes :meth:`commit_clocks` clocks.

    Parameters
    ----------
    width, height : :class:`int`
        Sensor size in pixels, 16 to 1024 each.
    beams, lanes : :class:`int`
        The paper's K and P, 1 to :data:`hdl.protocol.MOST_BEAMS` and 1 to ``beams``.
    preset : :class:`str`
        One of :data:`hdl.protocol.PRESET_NAMES`.
    clock_hz, baud : :class:`int`
        System clock, whole megahertz to 65; rate of the serial line out of reset.

    Members
    -------
    i, address, data, write_enable, write_data, damaged
        To the receiver's ``o``, ``address`` and so on.
    framing : :py:`In(1)`
        High for a clock: a character from the host had no stop bit.
    o : :py:`Out(stream.Signature(PacketOctet))`
        Replies. Their octets wait for nothing but ``o`` itself.
    apply : :py:`In(1)`
        A pattern frame starts, and no spot of an older frame is on its way.
    idle : :py:`In(1)`
        Nothing is in progress: no exposure, no frame, no spot, no packet on the line.
    single_done : :py:`In(1)`
        The single pair has been exposed.
    stop : :py:`Out(1)`
        The host wants no more frames.
    mode, period_us, and so on : :py:`Out`
        The registers of :func:`hdl.protocol.registers`, as they act, by their names.
    table_ready : :py:`In(1)`
        No spot needs the tables in the next two clocks.
    table_write, table_read : :py:`Out(1)`
        Write a word in this clock, or read it.
    table_select, table_address, table_data : :py:`Out(2)`, :py:`Out(10)`, :py:`Out(72)`
        Number of the table as in :data:`hdl.protocol.TABLES`, number of the word, and the word in
        the low bits; bits above it are undefined.
    table_word : :py:`In(72)`
        The word that was read, in the third clock after that of ``table_read``, zero above it.
    bank : :py:`Out(1)`
        Bank of the tables that acts.
    tables_valid : :py:`Out(1)`
        That bank was committed and checked, and no table with one bank was written since.
    capture : :py:`Out(1)`
        Calibration capture: the time that CAPTURE gave is not over.
    clear : :py:`Out(1)`
        High for a clock: forget the laser guard's causes.
    memory, memory_word : :py:`Out(stream.Signature(MemoryCommand))`, \
    :py:`In(stream.Signature(32, always_ready=True))`
        The external memory, in the preset ``paper`` only: word 2n has the lower half of word n of
        the remap table.
    laser_armed, sensor_silent, guard_causes, pairs, timeouts, bad_sync, overrun, skipped, \
    packets, late, display
        What else STATUS reports, see :data:`hdl.protocol.STATUS_FIELDS`.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a whole packet at ``i`` to its reply, for commands that neither read nor write
        tables and whose reply has no data. A refused command takes less.
    """

    latency = 18

    def __init__(self, width, height, beams, lanes, preset="capsule", clock_hz=16_000_000,
                 baud=115_200):
        for name, value, low, high in [
                ("Frame width", width, *SENSOR_PIXELS), ("Frame height", height, *SENSOR_PIXELS),
                ("Beams", beams, 1, MOST_BEAMS), ("Lanes", lanes, 1, beams),
                ("System clock", clock_hz, 1_000_000, 65_000_000)]:
            if not isinstance(value, int) or not low <= value <= high:
                raise ValueError(f"{name} must be an integer from {low} to {high}, not {value!r}")
        if clock_hz % 1_000_000:
            raise ValueError(f"System clock must be a multiple of 1 MHz, not {clock_hz}")
        if preset not in PRESET_NAMES:
            raise ValueError(f"Preset must be one of {', '.join(PRESET_NAMES)}, not {preset!r}")
        members = register_members(clock_hz, baud)
        self.register_names = tuple(members)
        self.preset = preset
        self.tables = tables(preset)
        self.counts = [table.count(beams, width * height) for table in self.tables]
        self.has_memory = preset == "paper"
        self.clock_hz = clock_hz
        self.baud = baud
        self.sensor = (width, height, beams)
        self.lanes = lanes
        super().__init__({
            "i": In(stream.Signature(7)),
            "address": Out(7),
            "data": In(8),
            "write_enable": Out(1),
            "write_data": Out(8),
            "damaged": In(1),
            "framing": In(1),
            "o": Out(stream.Signature(PacketOctet)),
            "apply": In(1),
            "idle": In(1),
            "single_done": In(1),
            "stop": Out(1, init=1),
            **members,
            "table_ready": In(1),
            **{name: member.flip() for name, member in TABLE_PORT.items()},
            "tables_valid": Out(1),
            "capture": Out(1),
            "clear": Out(1),
            "laser_armed": In(1),
            "sensor_silent": In(1),
            **status_ports("state", *_COUNTERS),
            **({"memory": Out(stream.Signature(MemoryCommand)),
                "memory_word": In(stream.Signature(32, always_ready=True))}
               if self.has_memory else {}),
        })

    def commit_clocks(self):
        """Clocks from a COMMIT to its reply, at most, while ``table_ready`` stays high, and the
        external memory is ready and answers within three clocks."""
        octets = sum(count * table.octets
                     for table, count in zip(self.tables, self.counts, strict=True))
        return 12 * octets + 11 * _CRC_OCTETS * len(self.tables) + 64

    def elaborate(self, platform):
        m = Module()
        m.submodules.registers = registers = Registers(self.clock_hz, self.baud)
        m.submodules.access = access = TableAccess(self.preset)
        m.submodules.fields = fields = ReplyFields(
            *self.sensor, self.lanes, self.preset, self.clock_hz)
        m.submodules.check = crc = CRC(data_width=1).create()
        m.submodules.capture_timer = capture_timer = CaptureTimer(self.clock_hz)
        s = _Shared(self.tables, self.counts, access, fields, registers, crc)
        m.d.comb += [
            self.address.eq(s.position),
            self.write_data.eq(s.octet),
            capture_timer.milliseconds.eq(s.word[:16]),
            self.capture.eq(capture_timer.capture),
        ]
        m.d.sync += s.data_valid.eq(1)
        self._connect_tables(m, s)
        self._report(m, s)
        damage_pending = Signal()
        with m.If(self.damaged):
            m.d.sync += damage_pending.eq(1)
        with m.FSM() as fsm:
            self._receive(m, s, damage_pending)
            self._execute(m, s, capture_timer)
            self._write_table(m, s)
            self._read_octets(m, s)
            self._check_tables(m, s)
            self._send(m, s)
        self._hand_over(m, s, fsm.ongoing("IDLE"))
        return m

    def _connect_tables(self, m, s):
        """The table that is selected, and the way to its words."""
        access = s.access
        with m.Switch(s.select):
            for table, count in zip(self.tables, self.counts, strict=True):
                with m.Case(table.number):
                    m.d.comb += [
                        s.octets.eq(table.octets),
                        s.last_octet.eq(s.octet_select[table.octets - 1]),
                        s.words.eq(count), s.most.eq(_DATA_LIMIT // table.octets),
                        s.banked.eq(table.banked)]
        m.d.comb += [
            s.last_word.eq(Mux(s.command == Command.COMMIT, s.word_index == s.words - 1,
                               s.words_left == 1)),
            access.number.eq(s.select),
            access.address.eq(s.word_index),
            access.word.eq(s.word),
            access.octet_select.eq(s.octet_select),
            access.table_ready.eq(self.table_ready),
            access.table_word.eq(self.table_word),
            *(getattr(self, name).eq(getattr(access, name)) for name in (
                "table_write", "table_read", "table_select", "table_address", "table_data")),
        ]
        if self.has_memory:
            wiring.connect(m, access.memory, wiring.flipped(self.memory))
            wiring.connect(m, wiring.flipped(self.memory_word), access.memory_word)

    def _report(self, m, s):
        """Values and counters for the replies."""
        fields, registers = s.fields, s.registers
        ok = s.reason == Reason.OK
        events = {
            "accepted": s.replied & ok, "refused": s.replied & ~ok & ~s.answers_damage,
            "damaged": self.damaged, "framing": self.framing}
        for name, event in events.items():
            port = getattr(fields, name)
            counter = Signal.like(port, name=f"{name}_count")
            with m.If(event & ~counter.all()):
                m.d.sync += counter.eq(counter + 1)
            m.d.comb += port.eq(counter)
        m.d.comb += [
            fields.register_value.eq(registers.read_data),
            fields.state.eq(Cat(
                self.tables_valid, self.laser_armed, self.capture, s.committed, self.bank,
                registers.mode, self.sensor_silent)),
            *(getattr(fields, name).eq(getattr(self, name))
              for name in status_ports("state", *_COUNTERS)),
        ]

    def _hand_over(self, m, s, waiting):
        """What was written begins to act with ``apply``, or between commands while stopped."""
        registers = s.registers
        m.d.comb += [
            s.stopped.eq(registers.mode == Mode.STOP),
            self.stop.eq(registers.stop),
            registers.single_done.eq(self.single_done),
            registers.hand_over.eq(self.apply | ((s.stopped | self.stop) & self.idle & waiting)),
            registers.address.eq(s.word[:8]),
            registers.value.eq(s.word[8:40]),
            *(getattr(self, name).eq(getattr(registers, name)) for name in self.register_names),
        ]
        with m.If(registers.hand_over & s.committed):
            m.d.sync += [self.bank.eq(~self.bank), self.tables_valid.eq(1), s.committed.eq(0)]

    def _receive(self, m, s, damage_pending):
        """A packet's command and its parameters, whose length is checked."""
        lengths = {**_LENGTHS, Command.COMMIT: 2 + _CRC_OCTETS * len(self.tables)}
        with m.State("IDLE"):
            m.d.sync += [
                s.reason.eq(Reason.OK), s.answers_damage.eq(0), s.last_position.eq(1),
                s.octet_select.eq(1)]
            with m.If(damage_pending):
                m.d.sync += [damage_pending.eq(self.damaged), s.answers_damage.eq(1)]
                s.refuse(m, Reason.DAMAGED_PACKET)
            with m.Elif(self.i.valid & s.data_valid):
                m.next = "COMMAND"

        with m.State("COMMAND"):
            m.d.sync += [s.command.eq(self.data), s.go_to(2)]
            m.next = "PARAMETERS"
            with m.Switch(self.data):
                for name, length in lengths.items():
                    with m.Case(name):
                        fits = (self.i.payload > length if name == Command.TABLE
                                else self.i.payload == length)
                        with m.If(~fits):
                            s.refuse(m, Reason.WRONG_LENGTH)
                with m.Default():
                    s.refuse(m, Reason.UNKNOWN_COMMAND)

        # Octets behind the end of a short packet are read too, and ignored.
        with m.State("PARAMETERS"), m.If(s.data_valid):
            self._load_octet(m, s, _PARAMETERS)
            with m.If(s.octet_select[_PARAMETERS - 1]):
                m.d.sync += [s.octet_select.eq(1), s.go_to(2)]
                m.next = "EXECUTE"

    def _load_octet(self, m, s, octets):
        """Put the buffer's octet into ``word``, one of its first ones, and go on to the next."""
        for index in range(octets):
            with m.If(s.octet_select[index]):
                m.d.sync += s.word[8 * index:8 * index + 8].eq(self.data)
        m.d.sync += [s.octet_select.eq(s.octet_select << 1), s.go_to(s.position + 1)]

    def _execute(self, m, s, capture_timer):
        """The command with its parameters."""
        registers, fields = s.registers, s.fields
        width, height, beams = self.sensor
        begin = width | height << 16 | beams << 32 | TABLE_VERSION << 48
        with m.State("EXECUTE"):
            m.d.sync += [
                s.select.eq(s.word[:len(s.select)]), s.word_index.eq(s.first), s.words_left.eq(0),
                s.octets_left.eq(self.i.payload - _TABLE_HEAD)]
            m.next = "REPLY"
            with m.Switch(s.command):
                with m.Case(Command.IDENTIFY):
                    m.d.comb += fields.start_identity.eq(1)
                    m.next = "FIELD"
                with m.Case(Command.STATUS):
                    m.d.comb += fields.start_status.eq(1)
                    m.next = "FIELD"
                with m.Case(Command.WRITE):
                    with m.If(~registers.known):
                        s.refuse(m, Reason.UNKNOWN_REGISTER)
                    with m.Elif(~registers.fits):
                        s.refuse(m, Reason.OUT_OF_RANGE)
                    with m.Elif(registers.only_stopped & ~s.stopped):
                        s.refuse(m, Reason.NOT_STOPPED)
                    with m.Else():
                        m.d.comb += registers.write.eq(1)
                with m.Case(Command.READ):
                    m.d.comb += fields.start_register.eq(registers.known)
                    m.next = "FIELD"
                    with m.If(~registers.known):
                        s.refuse(m, Reason.UNKNOWN_REGISTER)
                with m.Case(Command.BEGIN):
                    with m.If(s.word[:56] != begin):
                        s.refuse(m, Reason.OTHER_SENSOR)
                    with m.Elif(s.committed):
                        s.refuse(m, Reason.BUSY)
                    with m.Else():
                        m.d.sync += s.begun.eq(1)
                with m.Case(Command.TABLE, Command.READ_TABLE):
                    m.next = "COUNT"
                    with m.If(s.command == Command.READ_TABLE):
                        m.d.sync += s.words_left.eq(s.word[24:32])
                        m.next = "CHECK"
                    with m.If(s.word[:8] >= len(self.tables)):
                        s.refuse(m, Reason.UNKNOWN_TABLE)
                with m.Case(Command.COMMIT):
                    m.d.comb += s.crc.start.eq(1)
                    m.d.sync += [s.select.eq(0), s.word_index.eq(0)]
                    m.next = "READ"
                    with m.If(s.committed | ~self.table_ready):
                        s.refuse(m, Reason.BUSY)
                    with m.Elif(~s.begun):
                        s.refuse(m, Reason.NO_BEGIN)
                with m.Case(Command.CAPTURE):
                    m.d.comb += capture_timer.start.eq(1)
                with m.Case(Command.CLEAR):
                    m.d.comb += self.clear.eq(1)

    def _write_table(self, m, s):
        """TABLE, and with the checks READ_TABLE: the number of words, then one after the other."""
        is_write = s.command == Command.TABLE
        with m.State("COUNT"):
            m.d.sync += [
                s.octets_left.eq(s.octets_left - s.octets), s.words_left.eq(s.words_left + 1)]
            with m.If(s.octets_left == 0):
                m.d.sync += s.words_left.eq(s.words_left)
                m.next = "CHECK"
            with m.Elif(s.octets_left < s.octets):
                s.refuse(m, Reason.WRONG_LENGTH)

        with m.State("CHECK"):
            m.d.sync += s.go_to(Mux(is_write, _TABLE_HEAD, 2))
            m.next = "READ"
            with m.If(is_write):
                m.next = "FILL"
            with m.If((s.words_left == 0) | (s.words_left > s.most)
                      | (s.first + s.words_left > s.words)):
                s.refuse(m, Reason.OUT_OF_RANGE)
            with m.Elif(s.committed | ~self.table_ready):
                s.refuse(m, Reason.BUSY)
            with m.Elif(is_write):
                with m.If(~s.begun):
                    s.refuse(m, Reason.NO_BEGIN)
                with m.Elif(~s.banked & ~s.stopped):
                    s.refuse(m, Reason.NOT_STOPPED)

        with m.State("FILL"), m.If(s.data_valid):
            self._load_octet(m, s, len(s.octet_select))
            with m.If(s.last_octet):
                m.d.sync += s.octet_select.eq(1)
                m.next = "WRITE"

        with m.State("WRITE"):
            m.d.comb += s.access.write.eq(1)
            with m.If(s.access.done):
                m.d.sync += [
                    s.word_index.eq(s.word_index + 1), s.words_left.eq(s.words_left - 1)]
                with m.If(~s.banked):
                    m.d.sync += self.tables_valid.eq(0)
                m.next = "FILL"
                with m.If(s.last_word):
                    m.next = "REPLY"

    def _read_octets(self, m, s):
        """The next octet of a table or of a reply's fields, and into the buffer with it."""
        last_field = Signal()
        with m.State("READ"):
            m.d.comb += s.access.read.eq(1)
            with m.If(s.access.done):
                m.d.sync += s.octet.eq(s.access.octet)
                m.next = "STORE"
                with m.If(s.command == Command.COMMIT):
                    m.next = "SHIFT"

        with m.State("FIELD"):
            m.d.comb += s.fields.step.eq(1)
            m.d.sync += [s.octet.eq(s.fields.octet), last_field.eq(s.fields.last)]
            m.next = "STORE"

        with m.State("STORE"):
            m.d.comb += self.write_enable.eq(1)
            m.d.sync += [
                s.last_position.eq(s.position), s.go_to(s.position + 1),
                s.octet_select.eq(s.octet_select << 1)]
            with m.If(s.command == Command.READ_TABLE):
                m.next = "READ"
                with m.If(s.last_octet):
                    m.d.sync += [
                        s.octet_select.eq(1), s.word_index.eq(s.word_index + 1),
                        s.words_left.eq(s.words_left - 1)]
                    with m.If(s.last_word):
                        m.next = "REPLY"
            with m.Else():
                m.next = "FIELD"
                with m.If(last_field):
                    m.next = "REPLY"

    def _check_tables(self, m, s):
        """COMMIT: a table's octets through the check, then the check's own from the buffer."""
        bit = Signal(3)
        in_check = Signal()  # the octet is one of the check's
        with m.State("SHIFT"):
            m.d.comb += [s.crc.valid.eq(1), s.crc.data.eq(s.octet[0])]
            m.d.sync += [s.octet.eq(s.octet[1:]), bit.eq(bit + 1)]
            with m.If(bit == 7):
                m.d.sync += s.octet_select.eq(s.octet_select << 1)
                m.next = "READ"
                with m.If(in_check):
                    m.next = "EXPECT"
                    with m.If(s.octet_select[_CRC_OCTETS - 1]):
                        m.next = "COMPARE"
                with m.Elif(s.last_octet):
                    m.d.sync += [s.octet_select.eq(1), s.word_index.eq(s.word_index + 1)]
                    with m.If(s.last_word):
                        m.d.sync += in_check.eq(1)
                        m.next = "EXPECT"

        with m.State("EXPECT"), m.If(s.data_valid):
            m.d.sync += [s.octet.eq(self.data), s.go_to(s.position + 1)]
            m.next = "SHIFT"

        with m.State("COMPARE"):
            m.d.comb += s.crc.start.eq(1)
            m.d.sync += [
                in_check.eq(0), s.octet_select.eq(1), s.word_index.eq(0),
                s.select.eq(s.select + 1)]
            m.next = "READ"
            with m.If(~s.crc.match_detected):
                s.refuse(m, Reason.DAMAGED_TABLE)
            with m.Elif(s.select == len(self.tables) - 1):
                m.d.sync += [s.committed.eq(1), s.begun.eq(0)]
                m.next = "REPLY"

    def _send(self, m, s):
        """The reply: kind, tag, command, reason, and data from the buffer."""
        step = Signal(3)
        with m.State("REPLY"):
            m.d.sync += [step.eq(0), s.go_to(1)]
            m.next = "SEND"

        with m.State("SEND"):
            with m.Switch(step):
                with m.Case(0):
                    m.d.comb += [self.o.valid.eq(1), self.o.p.data.eq(PacketKind.REPLY)]
                with m.Case(3):
                    m.d.comb += [self.o.valid.eq(1), self.o.p.data.eq(s.reason)]
                with m.Default():
                    m.d.comb += [
                        self.o.valid.eq(s.data_valid),
                        self.o.p.data.eq(Mux(s.answers_damage, 0, self.data))]
            m.d.comb += self.o.p.last.eq(Mux(
                step[2], s.position == s.last_position, (step == 3) & (s.last_position == 1)))
            with m.If(self.o.valid & self.o.ready):
                m.d.sync += step.eq(step + 1)
                with m.Switch(step):
                    with m.Case(1):
                        m.d.sync += s.go_to(0)
                    with m.Case(2):
                        m.d.sync += s.go_to(2)
                    with m.Case(4):
                        m.d.sync += [step.eq(step), s.go_to(s.position + 1)]
                with m.If(self.o.p.last):
                    m.d.sync += s.go_to(0)
                    m.next = "DONE"

        with m.State("DONE"):
            m.d.comb += [s.replied.eq(1), self.i.ready.eq(~s.answers_damage)]
            m.next = "IDLE"
