"""What the host asks for, carried out and answered."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.payloads import MemoryCommand, PacketOctet
from hdl.protocol import (
    CONTENT_LIMIT,
    DISPLAY_FAULTS,
    GUARD_CAUSES,
    IDENTITY_FIELDS,
    PRESET_NAMES,
    PROTOCOL_VERSION,
    REMAP,
    STATUS_FIELDS,
    TABLE_VERSION,
    Command,
    Mode,
    PacketKind,
    Reason,
    tables,
)

from .receiver import CRC
from .registers import Registers, register_members

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
    Command.IDENTIFY: 2, Command.WRITE: 7, Command.READ: 3, Command.BEGIN: 8,
    Command.TABLE: _TABLE_HEAD,
    Command.READ_TABLE: 6, Command.STATUS: 2, Command.CAPTURE: 4, Command.CLEAR: 2,
}
_PARAMETERS = 7  # octets that are looked at together


class Commands(wiring.Component):
    """Carries out the host's commands, one at a time, and replies to each.

    This state machine takes the place of the paper's soft processor. It works through the
    receiver's buffer octet by octet. Each packet gets one reply; what is refused changes nothing.
    A damaged packet gets one too, in which command and tag are zero; damage that comes while a
    reply is on its way shares the next one. The buffer is let go when the reply's last octet was
    taken: the host waits for each reply. ``hdl/link/README.md`` has commands, registers, tables
    and the order of the checks.

    Registers are written at once, and act from the clock after ``apply``, all together; ``mode``
    set to stop, ``idle`` and no command under way do the same in every clock. ``stop`` tells of
    that mode at once, whatever the line and the spots are waiting for. A set of tables that
    was committed changes places with the old one then too, and ``tables_valid`` rises.

    Host accesses to the tables go to bank ``~bank``, where there are two. They come while
    ``table_ready`` is high, one in four clocks or fewer. The remap table of the preset
    ``paper`` is in its external memory, two words for each of the table's. COMMIT reads every word
    of a set once for each of its octets, and takes :meth:`commit_clocks` clocks.

    Parameters
    ----------
    width, height : :class:`int`
        Sensor size in pixels, 16 to 512 each.
    beams, lanes : :class:`int`
        The paper's K and P, 1 to 128 and 1 to ``beams``.
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
        Replies. No octet of a reply waits for anything but ``o`` itself.
    apply : :py:`In(1)`
        A pattern frame starts, and no spot of an older frame is under way.
    idle : :py:`In(1)`
        Nothing is under way: no exposure, no frame, no spot, no packet on the line.
    single_done : :py:`In(1)`
        The single pair has been exposed.
    stop : :py:`Out(1)`
        The host wants no more frames.
    mode, period_us, and so on : :py:`Out`
        The registers of :func:`hdl.protocol.registers`, by their names.
    table_ready : :py:`In(1)`
        No spot needs the tables in the next two clocks.
    table_write, table_read : :py:`Out(1)`
        Write a word in this clock, or read it.
    table_select, table_address, table_data : :py:`Out(2)`, :py:`Out(10)`, :py:`Out(72)`
        Number of the table as in :data:`hdl.protocol.TABLES`, number of the word, and the word in
        the low bits; above it anything.
    table_word : :py:`In(72)`
        The word that was read, in the third clock after that of ``table_read``, zero above it.
    bank : :py:`Out(1)`
        Bank of the tables that acts.
    tables_valid : :py:`Out(1)`
        It was committed and checked, and no table of one bank was written since.
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
        What STATUS tells besides, see :data:`hdl.protocol.STATUS_FIELDS`.
    """

    def __init__(self, width, height, beams, lanes, preset="capsule", clock_hz=16_000_000,
                 baud=115_200):
        for name, value, low, high in [
                ("Frame width", width, 16, 512), ("Frame height", height, 16, 512),
                ("Beams", beams, 1, 128), ("Lanes", lanes, 1, beams),
                ("System clock", clock_hz, 1_000_000, 65_000_000)]:
            if not isinstance(value, int) or not low <= value <= high:
                raise ValueError(f"{name} must be an integer from {low} to {high}, not {value!r}")
        if clock_hz % 1_000_000:
            raise ValueError(f"System clock must be a multiple of 1 MHz, not {clock_hz}")
        if preset not in PRESET_NAMES:
            raise ValueError(f"Preset must be one of {', '.join(PRESET_NAMES)}, not {preset!r}")
        members = register_members(clock_hz, baud)
        self.register_names = tuple(members)
        self.tables = tables(preset)
        self.counts = [table.count(beams, width * height) for table in self.tables]
        self.has_memory = preset == "paper"
        self.clock_hz = clock_hz
        self.baud = baud
        self.sensor = (width, height, beams)
        self.identity = {
            "protocol": PROTOCOL_VERSION, "tables": TABLE_VERSION, "width": width,
            "height": height, "beams": beams, "lanes": lanes,
            "preset": PRESET_NAMES.index(preset), "clock_khz": clock_hz // 1000,
        }
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
            "table_write": Out(1),
            "table_read": Out(1),
            "table_select": Out(2),
            "table_address": Out(10),
            "table_data": Out(72),
            "table_word": In(72),
            "bank": Out(1),
            "tables_valid": Out(1),
            "capture": Out(1),
            "clear": Out(1),
            "laser_armed": In(1),
            "sensor_silent": In(1),
            "guard_causes": In(len(GUARD_CAUSES)),
            "pairs": In(16),
            "timeouts": In(8),
            "bad_sync": In(8),
            "overrun": In(8),
            "skipped": In(8),
            "packets": In(16),
            "late": In(8),
            "display": In(len(DISPLAY_FAULTS)),
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
        m.submodules.check = crc = CRC(data_width=1).create()
        m.d.comb += [
            registers.single_done.eq(self.single_done),
            *(getattr(self, name).eq(getattr(registers, name)) for name in self.register_names),
        ]

        # The packet: where its next octet stands, whether the buffer shows that one, and its
        # parameters or a word of a table, octet by octet.
        command = Signal(Command)
        position = Signal(7)
        shown = Signal()
        word = Signal(72, reset_less=True)
        place = Signal(9, init=1)  # octet of the word, a bit for each
        m.d.comb += self.address.eq(position)
        m.d.sync += shown.eq(1)

        def move(to):
            return [position.eq(to), shown.eq(0)]

        def keep(octets):
            for index in range(octets):
                with m.If(place[index]):
                    m.d.sync += word[8 * index:8 * index + 8].eq(self.data)

        # The reply: where its data end, and the octet that comes next.
        reason = Signal(Reason)
        final = Signal(7)
        of_damage = Signal()
        octet = Signal(8)
        step = Signal(3)

        # Tables.
        largest = max(self.counts)
        select = Signal(range(len(self.tables)))
        first = word[8:24]
        place_in_table = Signal(range(largest))
        number = Signal(8)  # words to go
        room = Signal(7)
        octets, words, most = Signal(4), Signal(range(largest + 1)), Signal(8)
        last_octet, last_word = Signal(), Signal()
        banked = Signal()
        with m.Switch(select):
            for table, count in zip(self.tables, self.counts, strict=True):
                with m.Case(table.number):
                    m.d.comb += [
                        octets.eq(table.octets), last_octet.eq(place[table.octets - 1]),
                        words.eq(count), most.eq(_DATA_LIMIT // table.octets),
                        banked.eq(table.banked)]
        begun = Signal()
        committed = Signal()  # waits for its frame
        m.d.comb += [
            last_word.eq(Mux(command == Command.COMMIT, place_in_table == words - 1, number == 1)),
            self.table_select.eq(select),
            self.table_address.eq(place_in_table),
            self.table_data.eq(word),
        ]
        # The remap table lies in the external memory.
        in_memory = C(0, 1)
        if self.has_memory:
            in_memory = Signal()
            half = Signal()  # of the word that is written
            upper = half | place[4:8].any()
            memory = self.memory
            m.d.comb += [
                in_memory.eq(select == REMAP.number),
                memory.p.address.eq(Cat(upper, place_in_table)),
                memory.p.data.eq(word[:64].word_select(upper, 32)),
            ]
        stopped = Signal()
        waiting = Signal()
        m.d.comb += [
            stopped.eq(registers.mode == Mode.STOP),
            self.stop.eq(registers.stop),
            registers.hand_over.eq(self.apply | ((stopped | self.stop) & self.idle & waiting)),
            registers.address.eq(word[:8]),
            registers.value.eq(word[8:40]),
        ]
        with m.If(registers.hand_over & committed):
            m.d.sync += [self.bank.eq(~self.bank), self.tables_valid.eq(1), committed.eq(0)]

        done = Signal()
        damage_seen = Signal()
        with m.If(self.damaged):
            m.d.sync += damage_seen.eq(1)
        new_capture = Signal()
        self._time_capture(m, new_capture, word[:16])
        # Walks along the octets of the fields of a reply.
        walks = {kind: Signal(length, name=f"walk_{kind.name.lower()}") for kind, length in [
            (Command.IDENTIFY, self._octets(IDENTITY_FIELDS)),
            (Command.STATUS, self._octets(STATUS_FIELDS)), (Command.READ, 4)]}
        walking, last_field = Signal(), Signal()
        field = self._field(m, walks, walking, registers.read_data, {
            "state": Cat(self.tables_valid, self.laser_armed, self.capture, committed, self.bank,
                         registers.mode, self.sensor_silent),
            "guard_causes": self.guard_causes, "pairs": self.pairs, "timeouts": self.timeouts,
            "bad_sync": self.bad_sync, "overrun": self.overrun, "skipped": self.skipped,
            "commands": self._counter(m, "carried_out", 16, done & (reason == Reason.OK)),
            "refused": self._counter(
                m, "refused", 16, done & (reason != Reason.OK) & ~of_damage),
            "damaged": self._counter(m, "damages", 16, self.damaged),
            "framing": self._counter(m, "framings", 8, self.framing),
            "packets": self.packets, "late": self.late, "display": self.display,
        })

        shift = Signal()
        expecting = Signal()
        bit = Signal(3)
        m.d.comb += [
            self.write_data.eq(octet),
            crc.valid.eq(shift),
            crc.data.eq(octet[0]),
        ]
        with m.If(shift):
            m.d.sync += [octet.eq(octet[1:]), bit.eq(bit + 1)]

        def refuse(why):
            m.d.sync += reason.eq(why)
            m.next = "REPLY"

        lengths = {**_LENGTHS, Command.COMMIT: 2 + _CRC_OCTETS * len(self.tables)}
        with m.FSM():
            with m.State("IDLE"):
                m.d.comb += waiting.eq(1)
                m.d.sync += [
                    reason.eq(Reason.OK), of_damage.eq(0), final.eq(1), place.eq(1),
                    expecting.eq(0)]
                with m.If(damage_seen):
                    m.d.sync += [damage_seen.eq(self.damaged), of_damage.eq(1)]
                    refuse(Reason.DAMAGED_PACKET)
                with m.Elif(self.i.valid & shown):
                    m.next = "COMMAND"

            with m.State("COMMAND"):
                m.d.sync += [command.eq(self.data), move(2)]
                m.next = "PARAMETERS"
                with m.Switch(self.data):
                    for name, length in lengths.items():
                        with m.Case(name):
                            fits = (self.i.payload > length if name == Command.TABLE
                                    else self.i.payload == length)
                            with m.If(~fits):
                                refuse(Reason.WRONG_LENGTH)
                    with m.Default():
                        refuse(Reason.UNKNOWN_COMMAND)

            # What is behind the end of a short packet is looked at too, but not heard.
            with m.State("PARAMETERS"), m.If(shown):
                keep(_PARAMETERS)
                m.d.sync += [place.eq(place << 1), move(position + 1)]
                with m.If(place[_PARAMETERS - 1]):
                    m.d.sync += [place.eq(1), move(2)]
                    m.next = "EXECUTE"

            with m.State("EXECUTE"):
                m.d.sync += [
                    select.eq(word[:len(select)]), place_in_table.eq(first), number.eq(0),
                    room.eq(self.i.payload - _TABLE_HEAD)]
                m.next = "REPLY"
                with m.Switch(command):
                    with m.Case(Command.IDENTIFY):
                        m.d.sync += walks[Command.IDENTIFY].eq(1)
                        m.next = "FIELD"
                    with m.Case(Command.STATUS):
                        m.d.sync += walks[Command.STATUS].eq(1)
                        m.next = "FIELD"
                    with m.Case(Command.WRITE):
                        with m.If(~registers.known):
                            refuse(Reason.UNKNOWN_REGISTER)
                        with m.Elif(~registers.fits):
                            refuse(Reason.OUT_OF_RANGE)
                        with m.Elif(registers.only_stopped & ~stopped):
                            refuse(Reason.NOT_STOPPED)
                        with m.Else():
                            m.d.comb += registers.write.eq(1)
                    with m.Case(Command.READ):
                        m.d.sync += walks[Command.READ].eq(registers.known)
                        m.next = "FIELD"
                        with m.If(~registers.known):
                            refuse(Reason.UNKNOWN_REGISTER)
                    with m.Case(Command.BEGIN):
                        with m.If(word[:48] != self._begin()):
                            refuse(Reason.OTHER_SENSOR)
                        with m.Elif(committed):
                            refuse(Reason.BUSY)
                        with m.Else():
                            m.d.sync += begun.eq(1)
                    with m.Case(Command.TABLE, Command.READ_TABLE):
                        m.next = "COUNT"
                        with m.If(command == Command.READ_TABLE):
                            m.d.sync += number.eq(word[24:32])
                            m.next = "CHECK"
                        with m.If(word[:8] >= len(self.tables)):
                            refuse(Reason.UNKNOWN_TABLE)
                    with m.Case(Command.COMMIT):
                        m.d.comb += crc.start.eq(1)
                        m.d.sync += [select.eq(0), place_in_table.eq(0)]
                        m.next = "ASK"
                        with m.If(committed | ~self.table_ready):
                            refuse(Reason.BUSY)
                        with m.Elif(~begun):
                            refuse(Reason.NO_BEGIN)
                    with m.Case(Command.CAPTURE):
                        m.d.comb += new_capture.eq(1)
                    with m.Case(Command.CLEAR):
                        m.d.comb += self.clear.eq(1)

            # TABLE and READ_TABLE: how many words, and whether there are so many.
            with m.State("COUNT"):
                m.d.sync += [room.eq(room - octets), number.eq(number + 1)]
                with m.If(room == 0):
                    m.d.sync += number.eq(number)
                    m.next = "CHECK"
                with m.Elif(room < octets):
                    refuse(Reason.WRONG_LENGTH)

            with m.State("CHECK"):
                m.d.sync += move(Mux(command == Command.TABLE, _TABLE_HEAD, 2))
                m.next = "ASK"
                with m.If(command == Command.TABLE):
                    m.next = "FILL"
                with m.If((number == 0) | (number > most) | (first + number > words)):
                    refuse(Reason.OUT_OF_RANGE)
                with m.Elif(committed | ~self.table_ready):
                    refuse(Reason.BUSY)
                with m.Elif(command == Command.TABLE):
                    with m.If(~begun):
                        refuse(Reason.NO_BEGIN)
                    with m.Elif(~banked & ~stopped):
                        refuse(Reason.NOT_STOPPED)

            # TABLE: a word from the buffer, and away with it.
            with m.State("FILL"), m.If(shown):
                keep(9)
                m.d.sync += [place.eq(place << 1), move(position + 1)]
                with m.If(last_octet):
                    m.d.sync += place.eq(1)
                    m.next = "WRITE"

            written = Signal()
            with m.State("WRITE"):
                with m.If(~in_memory):
                    m.d.comb += [
                        self.table_write.eq(self.table_ready), written.eq(self.table_ready)]
                if self.has_memory:
                    with m.Else():
                        m.d.comb += [
                            memory.valid.eq(1), memory.p.write.eq(1), memory.p.lanes.eq(0b1111),
                            written.eq(memory.ready & upper)]
                        with m.If(memory.ready):
                            m.d.sync += half.eq(~half)
                with m.If(written):
                    m.d.sync += [place_in_table.eq(place_in_table + 1), number.eq(number - 1)]
                    with m.If(~banked):
                        m.d.sync += self.tables_valid.eq(0)
                    m.next = "FILL"
                    with m.If(last_word):
                        m.next = "REPLY"

            # READ_TABLE and COMMIT: the next octet of the tables.
            def take(answer):
                taken = 0
                for index, here in enumerate(place):
                    taken |= answer.word_select(index, 8) & here.replicate(8)
                m.d.sync += octet.eq(taken)
                m.next = "KEEP"
                with m.If(command == Command.COMMIT):
                    m.next = "SHIFT"

            with m.State("ASK"):
                with m.If(~in_memory):
                    m.d.comb += self.table_read.eq(self.table_ready)
                    with m.If(self.table_ready):
                        m.next = "ASKED"
                if self.has_memory:
                    with m.Else():
                        m.d.comb += memory.valid.eq(1)
                        with m.If(memory.ready):
                            m.next = "FETCH"
            with m.State("ASKED"):
                m.next = "ANSWER"
            with m.State("ANSWER"):
                m.next = "TAKE"
            with m.State("TAKE"):
                take(self.table_word)
            if self.has_memory:
                with m.State("FETCH"), m.If(self.memory_word.valid):
                    take(Cat(self.memory_word.p, self.memory_word.p, C(0, 8)))

            # All replies with data: the next octet of a field, into the buffer with the octet.
            with m.State("FIELD"):
                m.d.comb += walking.eq(1)
                m.d.sync += [
                    octet.eq(field),
                    last_field.eq(Cat(walk[-1] for walk in walks.values()).any())]
                m.next = "KEEP"

            with m.State("KEEP"):
                m.d.comb += self.write_enable.eq(1)
                m.d.sync += [final.eq(position), move(position + 1), place.eq(place << 1)]
                with m.If(command == Command.READ_TABLE):
                    m.next = "ASK"
                    with m.If(last_octet):
                        m.d.sync += [
                            place.eq(1), place_in_table.eq(place_in_table + 1),
                            number.eq(number - 1)]
                        with m.If(last_word):
                            m.next = "REPLY"
                with m.Else():
                    m.next = "FIELD"
                    with m.If(last_field):
                        m.next = "REPLY"

            # COMMIT: through the check; behind a table's last octet the check's own, from the
            # buffer.
            with m.State("SHIFT"):
                m.d.comb += shift.eq(1)
                with m.If(bit == 7):
                    m.d.sync += place.eq(place << 1)
                    m.next = "ASK"
                    with m.If(expecting):
                        m.next = "EXPECT"
                        with m.If(place[_CRC_OCTETS - 1]):
                            m.next = "COMPARE"
                    with m.Elif(last_octet):
                        m.d.sync += [place.eq(1), place_in_table.eq(place_in_table + 1)]
                        with m.If(last_word):
                            m.d.sync += expecting.eq(1)
                            m.next = "EXPECT"

            with m.State("EXPECT"), m.If(shown):
                m.d.sync += [octet.eq(self.data), move(position + 1)]
                m.next = "SHIFT"

            with m.State("COMPARE"):
                m.d.comb += crc.start.eq(1)
                m.d.sync += [
                    expecting.eq(0), place.eq(1), place_in_table.eq(0), select.eq(select + 1)]
                m.next = "ASK"
                with m.If(~crc.match_detected):
                    refuse(Reason.DAMAGED_TABLE)
                with m.Elif(select == len(self.tables) - 1):
                    m.d.sync += [committed.eq(1), begun.eq(0)]
                    m.next = "REPLY"

            with m.State("REPLY"):
                m.d.sync += [step.eq(0), move(1)]
                m.next = "SEND"

            with m.State("SEND"):
                with m.Switch(step):
                    with m.Case(0):
                        m.d.comb += [self.o.valid.eq(1), self.o.p.data.eq(PacketKind.REPLY)]
                    with m.Case(3):
                        m.d.comb += [self.o.valid.eq(1), self.o.p.data.eq(reason)]
                    with m.Default():
                        m.d.comb += [
                            self.o.valid.eq(shown), self.o.p.data.eq(Mux(of_damage, 0, self.data))]
                m.d.comb += self.o.p.last.eq(Mux(
                    step[2], position == final, (step == 3) & (final == 1)))
                with m.If(self.o.valid & self.o.ready):
                    m.d.sync += step.eq(step + 1)
                    with m.Switch(step):
                        with m.Case(1):
                            m.d.sync += move(0)
                        with m.Case(2):
                            m.d.sync += move(2)
                        with m.Case(4):
                            m.d.sync += [step.eq(step), move(position + 1)]
                    with m.If(self.o.p.last):
                        m.d.sync += move(0)
                        m.next = "DONE"

            with m.State("DONE"):
                m.d.comb += [done.eq(1), self.i.ready.eq(~of_damage)]
                m.next = "IDLE"

        return m

    @staticmethod
    def _counter(m, name, bits, event):
        """A counter that stops at its end."""
        value = Signal(bits, name=name)
        with m.If(event & ~value.all()):
            m.d.sync += value.eq(value + 1)
        return value

    def _time_capture(self, m, start, milliseconds):
        """``capture`` for so many milliseconds from the clock after ``start`` on."""
        # Both counters are one ahead, so that their signs tell of their ends. Subtracting ~y adds
        # y + 1: a choice before a subtrahend costs nothing on a carry chain.
        clocks = self.clock_hz // 1000
        clock = Signal(signed(clocks.bit_length() + 1))
        left = Signal(signed(17), init=-1)
        m.d.comb += self.capture.eq(~left[16])
        m.d.sync += clock.eq(clock - 1)
        with m.If(start | clock[-1]):
            m.d.sync += clock.eq(clocks - 2)
        with m.If(start | (clock[-1] & self.capture)):
            m.d.sync += left.eq(-2 - ~Mux(start, Cat(milliseconds, C(0, 1)), left))

    @staticmethod
    def _octets(fields):
        return sum(field.bits // 8 for field in fields)

    def _field(self, m, walks, walking, register, status):
        """The octet of a reply's fields at which one of ``walks`` stands.

        A bit walks along the octets of each kind of reply and shows one after the other, which
        takes less than multiplexers would. The upper octet of a number is kept when its lower one
        is shown, since the number may change meanwhile.
        """
        def at(kind, place, octet):
            return Value.cast(octet) & walks[kind][place].replicate(8)

        upper = Signal(8)
        octets, uppers, place = 0, 0, 0
        for entry in STATUS_FIELDS:
            value = status[entry.name]
            octets |= at(Command.STATUS, place, value[:8])
            if entry.bits == 16:
                uppers |= at(Command.STATUS, place, value[8:])
                octets |= at(Command.STATUS, place + 1, upper)
            place += entry.bits // 8
        place = 0
        for entry in IDENTITY_FIELDS:
            for index in range(entry.bits // 8):
                octets |= at(Command.IDENTIFY, place,
                             C(self.identity[entry.name] >> 8 * index & 0xFF, 8))
                place += 1
        for index in range(4):
            octets |= at(Command.READ, index, register.word_select(index, 8))
        with m.If(walking):
            m.d.sync += [upper.eq(uppers), *(walk.eq(walk << 1) for walk in walks.values())]
        return octets

    def _begin(self):
        """The parameters of a BEGIN for this chip."""
        width, height, beams = self.sensor
        return width | height << 16 | beams << 32 | TABLE_VERSION << 40
