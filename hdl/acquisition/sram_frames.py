"""Frames between two clocks, in an external memory."""

from amaranth import *
from amaranth.lib import data, enum, stream, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.fifo import SyncFIFOBuffered
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from ..payloads import MemoryCommand, StoredFrame
from .frame_banks import FrameBanks, check_store, store_members

__all__ = ["SRAMFrames"]

_COUNT_BITS = 8
_ADDRESS_BITS = 19
#: Words that may wait for the memory: a RAMB16 of them.
_QUEUE = 512
#: Words of half the line buffer.
_HALF = 128


class _Kind(enum.Enum, shape=2):
    """What is in the queue: a frame is a header with its information, then its words."""

    HEADER = 0
    WORD = 1
    LAST = 2


class _Entry(data.Struct):
    word: 32
    kind: _Kind


class SRAMFrames(wiring.Component):
    """Stores frames in an external memory, and fetches the rows that a reader is about to show.

    Replaces :class:`.FrameMemory` on devices that have no room for it. Frames come in the domain
    ``sync``, a pixel in every clock if need be, and are read, whole, in ``display``;
    :class:`.FrameBanks` shares the banks. Four pixels make a word, the first one in the lowest
    bits; each row begins with a new word, each bank with a new row.

    The memory gets one write for each word of a frame that arrives, and, for each row that is
    fetched, one read for each word of a row: 88 writes and 88 reads a row for frames 352 wide,
    writes first. A buffer holds 512 words that wait for it. If the buffer is full, the rest of the
    frame is discarded, and the frame counts as broken.

    A row is fetched into one half of a line buffer while the row before is read from the other. If
    it has not arrived when the reader turns to it, it reads as zero until the reader turns to the
    next one, and is counted; so is a row that is requested while the last fetch is under way. A
    bank is given back only when no fetch is under way.

    Parameters
    ----------
    width, height : :class:`int`
        Frame size in pixels.
    banks : :class:`int`
        2, or 3 so that no frame is ever skipped.
    base : :class:`int`
        Address of the first bank's first word.
    shape : shape-like
        Information that is kept with a frame, 32 bits at most.

    Members
    -------
    i, info, broken, skipped, unread
        The writer's side, as of :class:`.FrameMemory`; a frame that is skipped and breaks off
        counts as both.
    overrun : :py:`Out(1)`
        Since reset, the buffer has overflowed.
    acquire, give_back, idle, held, fresh, frame
        The reader's side, as of :class:`.FrameBanks`.
    fetch : :py:`In(1)`
        Fetch a row of the held frame (``display``).
    fetch_row : :py:`In(range(height))`
        Its number.
    turn : :py:`In(1)`
        From this clock on the reader reads another row.
    row, column : :py:`In(range(height))`, :py:`In(range(width))`
        Pixel to be read, of one of the two rows that were fetched last.
    data : :py:`Out(8)`
        Its grey value, two clocks later.
    late : :py:`Out(8)`
        Rows that did not arrive in time (``display``). It stops at 255.
    command : :py:`Out(stream.Signature(MemoryCommand))`
        Accesses.
    answer : :py:`In(stream.Signature(32, always_ready=True))`
        The words of the reads, in their order.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from ``row`` and ``column`` to ``data``.
    row_words, bank_words : :class:`int`
        Words of a row and of a bank.
    """

    latency = 2

    def __init__(self, width, height, banks=3, base=0, shape=StoredFrame):
        check_store(width, height, banks)
        self.row_words = -(-width // 4)
        self.bank_words = self.row_words * height
        most = (1 << _ADDRESS_BITS) - banks * self.bank_words
        if not isinstance(base, int) or not 0 <= base <= most:
            raise ValueError(
                f"The address of the first bank must be an integer from 0 to {most}, not {base!r}")
        if Shape.cast(shape).width > 32:
            raise ValueError(f"A frame's information must fit 32 bits, which {shape!r} does not")
        self.width, self.height, self.banks, self.shape = width, height, banks, shape
        self.starts = [base + bank * self.bank_words for bank in range(banks)]
        super().__init__({
            **store_members(shape),
            "overrun": Out(1),
            "fetch": In(1),
            "fetch_row": In(range(height)),
            "turn": In(1),
            "row": In(range(height)),
            "column": In(range(width)),
            "data": Out(8),
            "late": Out(_COUNT_BITS),
            "command": Out(stream.Signature(MemoryCommand)),
            "answer": In(stream.Signature(32, always_ready=True)),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.banks = banks = FrameBanks(self.banks, self.shape)
        m.submodules.queue = queue = SyncFIFOBuffered(
            width=Shape.cast(_Entry).width, depth=_QUEUE)
        self._pack(m, queue)
        read_address = Signal(_ADDRESS_BITS)
        reads, read_taken = Signal(), Signal()
        self._access(m, queue, banks, reads, read_address, read_taken)
        self._lines(m, banks, reads, read_address, read_taken)
        return m

    def _pack(self, m, queue):
        """Pixels to words, as long as the queue is not full."""
        inside = Signal()
        lost = Signal()  # the rest of the frame is discarded
        lane = Signal(2)
        pixels = Signal(24)
        words = Signal(range(self.bank_words + 1))
        first = Signal()
        full = Signal()  # this pixel completes a word
        overflows = Signal()
        fails = Signal()
        whole = Signal()
        marker = self.i.p.marker
        entry = Signal(_Entry)
        m.d.comb += [
            first.eq(self.i.valid & ~inside & ~marker.broken),
            full.eq(self.i.valid & ~marker.broken & ((lane == 3) | marker.line_end)),
            overflows.eq((first | (full & ~lost)) & ~queue.w_rdy),
            fails.eq(overflows | full & (first | (words == self.bank_words))),
            whole.eq(~marker.broken & ~fails & ~lost & (words == self.bank_words - 1)),
            queue.w_en.eq(first | (full & ~lost & ~fails)),
            queue.w_data.eq(entry),
        ]
        with m.If(overflows):
            m.d.sync += self.overrun.eq(1)
        with m.If(first):
            m.d.comb += [entry.kind.eq(_Kind.HEADER), entry.word.eq(self.info)]
        with m.Else():
            m.d.comb += entry.kind.eq(Mux(marker.frame_end & whole, _Kind.LAST, _Kind.WORD))
            with m.Switch(lane):
                for number in range(4):
                    with m.Case(number):
                        m.d.comb += entry.word.eq(Cat(pixels[:8 * number], self.i.p.grey))
        with m.If(self.i.valid):
            with m.Switch(lane):
                for number in range(3):
                    with m.Case(number):
                        m.d.sync += pixels[8 * number:8 * number + 8].eq(self.i.p.grey)
            m.d.sync += [inside.eq(1), lost.eq(lost | fails),
                         lane.eq(Mux(marker.line_end, 0, lane + 1))]
            with m.If(full & ~fails & ~lost):
                m.d.sync += words.eq(words + 1)
            with m.If(marker.frame_end):
                m.d.sync += [inside.eq(0), lost.eq(0), words.eq(0)]
                with m.If((inside | first) & ~whole):
                    m.d.sync += self.broken.eq(self.broken + ~self.broken.all())

    def _access(self, m, queue, banks, reads, read_address, read_taken):
        """Writes from the queue, reads while there are none, through a register."""
        entry = Signal(_Entry)
        taking = Signal()
        closes = Signal()  # the command is a frame's last write
        free = Signal()
        address = Signal(_ADDRESS_BITS)
        info = Signal(self.shape)
        m.d.comb += [
            entry.eq(queue.r_data),
            free.eq(~self.command.valid | self.command.ready),
            banks.info.eq(info),
            banks.closes.eq(self.command.valid & self.command.ready & closes),
            self.skipped.eq(banks.skipped),
            self.unread.eq(banks.unread),
        ]
        with m.If(free):
            m.d.sync += [self.command.valid.eq(0), closes.eq(0)]
        with m.If(queue.r_rdy & (entry.kind == _Kind.HEADER) & ~closes):
            m.d.comb += [queue.r_en.eq(1), banks.opens.eq(1)]
            m.d.sync += [taking.eq(banks.free), Value.cast(info).eq(entry.word)]
            with m.Switch(banks.write_bank):
                for bank, start in enumerate(self.starts):
                    with m.Case(bank):
                        m.d.sync += address.eq(start)
        with m.Elif(queue.r_rdy & (entry.kind != _Kind.HEADER) & ~taking):
            m.d.comb += queue.r_en.eq(1)
        with m.Elif(queue.r_rdy & (entry.kind != _Kind.HEADER) & free):
            m.d.comb += queue.r_en.eq(1)
            m.d.sync += [
                self.command.valid.eq(1), self.command.p.write.eq(1),
                self.command.p.address.eq(address), self.command.p.data.eq(entry.word),
                self.command.p.lanes.eq(0b1111), address.eq(address + 1),
                closes.eq(entry.kind == _Kind.LAST),
            ]
        with m.Elif(reads & free):
            m.d.comb += read_taken.eq(1)
            m.d.sync += [self.command.valid.eq(1), self.command.p.write.eq(0),
                         self.command.p.address.eq(read_address)]

    def _lines(self, m, banks, reads, read_address, read_taken):
        """Rows to the line buffer, and from there to the reader."""
        m.submodules.line = line = Memory(shape=32, depth=2 * _HALF, init=[])
        put, get = line.write_port(), line.read_port(domain="display")

        # The reader raises its request and holds it until it sees the answer, which comes with the
        # last word. Meanwhile `wanted` and the bank are stable, so they cross as they are.
        request = Signal()  # in `display`
        wanted = Signal(range(self.height))
        request_synced = Signal()  # in `sync`
        answer = Signal()
        answer_synced = Signal()  # in `display`
        m.submodules.request = FFSynchronizer(request, request_synced)
        m.submodules.answer = FFSynchronizer(answer, answer_synced, o_domain="display")

        # In `sync`.
        fetching = Signal()
        odd = Signal()
        left = Signal(range(self.row_words + 1))  # words to ask for
        received = Signal(range(_HALF))  # words that have arrived
        m.d.comb += [
            reads.eq(left != 0),
            put.addr.eq(Cat(received, odd)),
            put.data.eq(self.answer.payload),
            put.en.eq(self.answer.valid),
        ]
        with m.If(~request_synced):
            m.d.sync += answer.eq(0)
        with m.Elif(~fetching & ~answer):
            offset = sum(wanted << bit for bit in range(8) if self.row_words >> bit & 1)
            with m.Switch(banks.read_bank):
                for bank, start in enumerate(self.starts):
                    with m.Case(bank):
                        m.d.sync += read_address.eq(start + offset)
            m.d.sync += [fetching.eq(1), left.eq(self.row_words), received.eq(0), odd.eq(wanted[0])]
        with m.If(read_taken):
            m.d.sync += [read_address.eq(read_address + 1), left.eq(left - 1)]
        with m.If(self.answer.valid):
            m.d.sync += received.eq(received + 1)
            with m.If(received == self.row_words - 1):
                m.d.sync += [fetching.eq(0), answer.eq(1)]

        # In `display`. For each half of the buffer: whether its row has arrived.
        arrived = Signal(2)
        asked = [Signal(range(self.height), name=f"asked_{half}") for half in range(2)]
        fetch_idle = Signal()
        bank_pending = Signal()  # a request of another bank waits until no fetch is under way
        wants_bank = Signal()
        m.d.comb += [
            fetch_idle.eq(~request & ~answer_synced),
            self.idle.eq(banks.idle & ~bank_pending),
            self.held.eq(banks.held & ~bank_pending),
            self.fresh.eq(banks.fresh),
            self.frame.eq(banks.frame),
            banks.acquire.eq(bank_pending & fetch_idle & wants_bank),
            banks.give_back.eq(bank_pending & fetch_idle & ~wants_bank),
        ]
        with m.If(self.idle & (self.acquire | self.give_back)):
            m.d.display += [bank_pending.eq(1), wants_bank.eq(self.acquire)]
        with m.Elif(fetch_idle):
            m.d.display += bank_pending.eq(0)
        with m.If(request & answer_synced):
            m.d.display += request.eq(0)
        for half in range(2):
            with m.If(request & answer_synced & (wanted == asked[half])):
                m.d.display += arrived[half].eq(1)
            with m.If(self.fetch & (self.fetch_row[0] == half)):
                m.d.display += [arrived[half].eq(0), asked[half].eq(self.fetch_row)]
        with m.If(self.fetch & fetch_idle & self.held):
            m.d.display += [request.eq(1), wanted.eq(self.fetch_row)]
        with m.If(self.acquire | self.give_back):
            m.d.display += arrived.eq(0)

        chosen = Signal(2)
        row_arrived = Signal()
        m.d.comb += [get.addr.eq(Cat(self.column[2:], C(0, 7 - len(self.column[2:])),
                                     self.row[0])), get.en.eq(1)]
        m.d.display += [
            chosen.eq(self.column[:2]),
            self.data.eq(Mux(row_arrived, get.data.word_select(chosen, 8), 0)),
        ]
        with m.If(self.turn):
            m.d.display += row_arrived.eq(arrived.bit_select(self.row[0], 1))
            with m.If(self.held & ~arrived.bit_select(self.row[0], 1)):
                m.d.display += self.late.eq(self.late + ~self.late.all())
