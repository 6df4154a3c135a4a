"""The banks of a frame store, shared between a writer and a reader."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.cdc import FFSynchronizer
from amaranth.lib.wiring import In, Out

from ..payloads import GreyPixel, StoredFrame

__all__ = ["FrameBanks", "check_banks", "check_store", "store_members"]

_COUNT_BITS = 8


def check_banks(banks):
    """ValueError unless ``banks`` is 2 or 3."""
    if banks not in (2, 3) or isinstance(banks, bool):
        raise ValueError(f"The number of banks must be 2 or 3, not {banks!r}")


def check_store(width, height, banks):
    """ValueError unless these are a frame's size and a number of banks."""
    for name, value in (("width", width), ("height", height)):
        if not isinstance(value, int) or not 2 <= value <= 512:
            raise ValueError(f"Frame {name} must be an integer from 2 to 512, not {value!r}")
    check_banks(banks)


def store_members(shape):
    """Members that every frame store has; ``shape`` is the information kept with a frame."""
    return {
        "i": In(stream.Signature(GreyPixel, always_ready=True)),
        "info": In(shape),
        "broken": Out(_COUNT_BITS),
        "skipped": Out(_COUNT_BITS),
        "unread": Out(_COUNT_BITS),
        "acquire": In(1),
        "give_back": In(1),
        "idle": Out(1),
        "held": Out(1),
        "fresh": Out(1),
        "frame": Out(shape),
    }


class FrameBanks(wiring.Component):
    """Shares the banks of a frame store between a writer and a reader with unrelated clocks.

    The writer works in the domain ``sync``, the reader in the domain ``display``. A frame goes to
    a bank that is neither held by the reader nor keeps the newest whole frame. With three banks
    there always is one. With two there is none while the reader holds one and the other keeps a
    newer frame: a frame that begins then is skipped whole, and counted; of frames without a pause
    between them every second one is, however quick the reader. The reader may request a frame at
    any time, and gets the newest whole one.

    The reader raises a request line and holds it until it sees the answer; the writer answers in
    the same way. Both lines go through two flip-flops. The bank number and its frame's information
    are stable from before the answer rises until the next request. The reader's side samples them
    only when the answer has arrived, so they need no synchronisers of their own.

    Reset empties all banks; both domains must be reset together, each for at least 4 clocks of the
    other.

    Parameters
    ----------
    banks : :class:`int`
        2 or 3.
    shape : shape-like
        Information that is kept with a frame.

    Members
    -------
    opens : :py:`In(1)`
        A frame begins in this clock (``sync``).
    free : :py:`Out(1)`
        High if that frame may be written.
    write_bank : :py:`Out(2)`
        Bank to write to, from that clock on until the frame's end.
    closes : :py:`In(1)`
        The frame that was written is whole; its last word is written in this clock.
    info : :py:`In(shape)`
        Its information, sampled in that clock.
    skipped, unread : :py:`Out(8)`
        Frames for which no bank was free, and whole frames that a newer one replaced before the
        reader requested them. They stop at 255.
    acquire : :py:`In(1)`
        The reader gives back its bank and requests the newest frame (``display``). What it has
        read up to this clock is valid. Ignored unless ``idle`` is high.
    give_back : :py:`In(1)`
        The reader gives back its bank and requests no other. Ignored likewise, and with
        ``acquire``.
    idle : :py:`Out(1)`
        The reader may send a request.
    held : :py:`Out(1)`
        The reader has a bank. Low in the clock after a request; after the answer it stays low if
        no frame has been stored yet.
    fresh : :py:`Out(1)`
        It was not read before.
    read_bank : :py:`Out(2)`
        Its number, while ``held``.
    frame : :py:`Out(shape)`
        Its information, while ``held``.

    Attributes
    ----------
    latency : :class:`int`
        Clocks of ``display``, besides up to 4 of ``sync``, from a request to its answer, at most.
    """

    latency = 5

    def __init__(self, banks=2, shape=StoredFrame):
        check_banks(banks)
        self.banks, self.shape = banks, shape
        super().__init__({
            "opens": In(1),
            "free": Out(1, init=1),
            "write_bank": Out(range(banks)),
            "closes": In(1),
            "info": In(shape),
            "skipped": Out(_COUNT_BITS),
            "unread": Out(_COUNT_BITS),
            "acquire": In(1),
            "give_back": In(1),
            "idle": Out(1),
            "held": Out(1),
            "fresh": Out(1),
            "read_bank": Out(range(banks)),
            "frame": Out(shape),
        })

    def elaborate(self, platform):
        m = Module()
        bank = range(self.banks)

        # Roles of the banks, in `sync`. The writer's is neither the newest one nor the reader's;
        # the newest one may be the reader's too. A frame's information goes with the role.
        newest = Signal(bank)
        newest_exists = Signal()
        newest_is_unread = Signal()
        reader = Signal(bank)
        reader_exists = Signal()
        reader_is_fresh = Signal()
        newest_info = Signal(self.shape)
        reader_info = Signal(self.shape)

        request = Signal()  # in `display`
        wants = Signal()
        request_synced = Signal()  # in `sync`
        answer = Signal()
        answer_synced = Signal()  # in `display`
        m.submodules.request = FFSynchronizer(request, request_synced)
        m.submodules.answer = FFSynchronizer(answer, answer_synced, o_domain="display")

        # The writer's side. A request that comes with the end of a frame waits a clock, and gets
        # that frame.
        grants = Signal()
        m.d.comb += grants.eq(request_synced & ~answer & ~self.closes)
        with m.If(grants):
            m.d.sync += answer.eq(1)
        with m.Elif(~request_synced):
            m.d.sync += answer.eq(0)

        with m.If(self.opens & ~self.free):
            m.d.sync += self.skipped.eq(self.skipped + ~self.skipped.all())
        with m.If(self.closes):
            m.d.sync += [
                newest.eq(self.write_bank), newest_exists.eq(1), newest_is_unread.eq(1),
                newest_info.eq(self.info),
                self.unread.eq(self.unread + (newest_is_unread & ~self.unread.all())),
            ]
            with m.Switch(Cat(self.write_bank, reader, reader_exists)):
                for written in bank:
                    for held in (None, *bank):
                        left = [number for number in bank if number not in (written, held)]
                        with m.Case(self._case(written, held)):
                            m.d.sync += [self.write_bank.eq(left[0] if left else written),
                                         self.free.eq(bool(left))]
        with m.If(grants):
            m.d.sync += reader_exists.eq(wants & newest_exists)
            with m.If(wants):
                m.d.sync += [
                    reader.eq(newest), reader_info.eq(newest_info),
                    reader_is_fresh.eq(newest_is_unread), newest_is_unread.eq(0),
                ]
            if self.banks == 2:
                with m.If(~self.free):
                    m.d.sync += [self.write_bank.eq(~newest), self.free.eq(1)]

        # The reader's side. The next request waits until the answer to the last one has gone.
        m.d.comb += self.idle.eq(~request & ~answer_synced)
        with m.If(self.idle & (self.acquire | self.give_back)):
            m.d.display += [request.eq(1), wants.eq(self.acquire), self.held.eq(0)]
        with m.If(request & answer_synced):
            m.d.display += [
                request.eq(0), self.held.eq(reader_exists), self.fresh.eq(reader_is_fresh),
                self.read_bank.eq(reader), self.frame.eq(reader_info),
            ]
        return m

    def _case(self, written, held):
        """Pattern of the written bank, the reader's bank and whether the reader has one."""
        bits = len(self.read_bank)
        reader = f"0{'-' * bits}" if held is None else f"1{held:0{bits}b}"
        return f"{reader}{written:0{bits}b}"
