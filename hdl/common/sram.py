"""Clients of one external asynchronous static RAM."""

from amaranth import *
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from ..payloads import MemoryCommand

__all__ = ["SRAMPins", "SRAMPort"]


class SRAMPins(wiring.Signature):
    """Pins of a static RAM of 512K words of 32 bits, seen from its controller.

    Members
    -------
    address : :py:`Out(19)`
        Word.
    data_out, data_drive : :py:`Out(32)`, :py:`Out(1)`
        Value that the data pins are driven with, and when.
    data_in : :py:`In(32)`
        Value of the data pins.
    chip_enable_n, write_enable_n, output_enable_n : :py:`Out(1)`
        Strobes of the memory, active low.
    lanes_n : :py:`Out(4)`
        Byte lanes, active low, lowest byte first.
    """

    def __init__(self):
        super().__init__({
            "address": Out(19),
            "data_out": Out(32),
            "data_in": In(32),
            "data_drive": Out(1),
            "chip_enable_n": Out(1, init=1),
            "write_enable_n": Out(1, init=1),
            "output_enable_n": Out(1, init=1),
            "lanes_n": Out(4, init=0b1111),
        })


class SRAMPort(wiring.Component):
    """Shares an asynchronous static RAM between clients; client 0 goes first.

    A read takes one clock, a write two, in any order and without a pause between them. The client
    with the lowest number that has a command is served; the others may starve, so clients with low
    numbers must leave clocks free. The word of a read is valid at the client's ``answer`` for one
    clock, and must be taken then. Answers come in the order of the commands. A read sees all writes
    that were taken before it, from any client.

    Nothing is taken during reset; a write that was taken before is still carried out, and pending
    answers are lost.

    **Timing.** All pins come from flip-flops: address, lanes, chip enable and data from those of
    the rising edge; write and output enable from those of the falling edge, so that half a clock
    lies between any two steps. Inputs are sampled with the rising edge::

        clock    __/--\\__/--\\__/--\\__/--\\__/--\\__/--\\__
        address  ==X read X    write    X read X
        OE#      -----\\_____/-----------\\_____/----
        WE#      -----------\\_____/----------------
        driven   --------------/-----\\-------------
        sampled           ^                 ^

    A write has half a clock of address set-up before WE# falls, a pulse of a clock, and half a
    clock of address and data hold behind it; data are valid for half a clock before WE# rises.
    After a read the memory has half a clock to release the bus before it is driven, and after a
    write half a clock passes before the memory may drive it. So ordinary parts are used within
    their data sheets, with 0 ns of set-up and hold, and there is no contention on the bus: at
    16 MHz half a clock is 31 ns, where a part of 15 ns needs a pulse of 15 ns and data 10 ns before
    its end, releases the bus in 8 ns, and answers 15 ns after the address and 8 ns after OE#. The
    bus floats for half a clock or more between drivers: use the weak keepers of the pins.

    Parameters
    ----------
    clients : :class:`int`
        Number of clients, 1 to 16.

    Members
    -------
    command : :py:`In(stream.Signature(MemoryCommand)).array(clients)`
        Accesses. The lanes of a read do not matter: all bytes are read.
    answer : :py:`Out(stream.Signature(32, always_ready=True)).array(clients)`
        The words of the reads.
    pins : :py:`Out(SRAMPins())`
        The memory.

    Attributes
    ----------
    latency : :class:`int`
        Clocks from a read that is taken to its answer.
    """

    latency = 2

    def __init__(self, clients=1):
        if not isinstance(clients, int) or not 1 <= clients <= 16:
            raise ValueError(f"Clients must be an integer from 1 to 16, not {clients!r}")
        self.clients = clients
        super().__init__({
            "command": In(stream.Signature(MemoryCommand)).array(clients),
            "answer": Out(stream.Signature(32, always_ready=True)).array(clients),
            "pins": Out(SRAMPins()),
        })

    def elaborate(self, platform):
        m = Module()
        m.domains += ClockDomain("falling", clk_edge="neg", reset_less=True, local=True)
        m.d.comb += ClockSignal("falling").eq(ClockSignal())

        # A write's first clock; in it nothing can be taken. The registers of a write are not reset:
        # a reset must not cut it short.
        writing = Signal(reset_less=True)
        reading = Signal(reset_less=True)
        free = Signal()
        m.d.comb += free.eq(~writing & ~ResetSignal())

        before = Const(0)
        taking = []
        for command in self.command:
            m.d.comb += command.ready.eq(free & ~before)
            taking.append(command.valid & command.ready)
            before = before | command.valid

        address = Signal(19, reset_less=True)
        data = Signal(32, reset_less=True)
        drive = Signal(reset_less=True)
        idle = Signal(init=1, reset_less=True)
        lanes_n = Signal(4, init=0b1111, reset_less=True)
        read = Signal()
        m.d.sync += [
            reading.eq(read),
            writing.eq(0),
            drive.eq(writing),
            idle.eq(~writing),
        ]
        for command, take in zip(self.command, taking, strict=True):
            with m.If(take):
                m.d.comb += read.eq(~command.p.write)
                m.d.sync += [
                    writing.eq(command.p.write),
                    idle.eq(0),
                    address.eq(command.p.address),
                    data.eq(command.p.data),
                    lanes_n.eq(Mux(command.p.write, ~command.p.lanes, 0)),
                ]
        write_enable_n = Signal(init=1)
        output_enable_n = Signal(init=1)
        m.d.falling += [write_enable_n.eq(~writing), output_enable_n.eq(~reading)]

        m.d.comb += [
            self.pins.address.eq(address),
            self.pins.data_out.eq(data),
            self.pins.data_drive.eq(drive),
            self.pins.chip_enable_n.eq(idle),
            self.pins.write_enable_n.eq(write_enable_n),
            self.pins.output_enable_n.eq(output_enable_n),
            self.pins.lanes_n.eq(lanes_n),
        ]

        word = Signal(32, reset_less=True)
        m.d.sync += word.eq(self.pins.data_in)
        for index, (answer, take) in enumerate(zip(self.answer, taking, strict=True)):
            asked = Signal(name=f"asked_{index}")
            m.d.sync += [asked.eq(take & read), answer.valid.eq(asked)]
            m.d.comb += answer.p.eq(word)

        return m
