"""Two-pass labelling with its memory, as one block for the native engine."""

from amaranth import Cat, Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.common.sram import SRAMPins, SRAMPort
from hdl.payloads import MaskPixel, Spot
from hdl.preprocessing.two_pass_labelling import TwoPassLabelling
from tb.common.sram_chip import SRAMChip

__all__ = ["TwoPassPins", "TwoPassRig"]


class TwoPassRig(wiring.Component):
    """Mask pixels in, spots out; client 0 of the memory is a stranger.

    The stranger writes the memory's last word, each clock with a chance of ``traffic`` in 256.
    """

    def __init__(self, width, height, labels=1023, base=0, interval=1):
        self.labelling = TwoPassLabelling(width, height, labels, base, interval)
        self.address_bits = (base + (width * height + 1) // 2).bit_length()
        super().__init__({
            "i": In(stream.Signature(MaskPixel)),
            "o": Out(stream.Signature(Spot)),
            "traffic": In(8),
            "dropped": Out(16),
            "violations": Out(16),
            "unwritten": Out(16),
            "reads": Out(32),
            "writes": Out(32),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.labelling = labelling = self.labelling
        m.submodules.port = port = SRAMPort(2)
        m.submodules.chip = chip = SRAMChip(self.address_bits)
        stranger, client = port.command
        connect(m, labelling.command, client)
        connect(m, port.answer[1], labelling.answer)
        connect(m, port.pins, chip.pins)
        connect(m, flipped(self.i), labelling.i)
        connect(m, labelling.o, flipped(self.o))
        m.d.comb += [
            *(getattr(self, name).eq(getattr(chip, name))
              for name in ("violations", "unwritten", "reads", "writes")),
            self.dropped.eq(labelling.dropped),
        ]

        noise = Signal(32, init=0x2545F491)
        m.d.sync += noise.eq(Cat(noise[31] ^ noise[21] ^ noise[1] ^ noise[0], noise))
        m.d.comb += [
            stranger.p.write.eq(1),
            stranger.p.lanes.eq(0b1111),
            stranger.p.data.eq(noise),
            stranger.p.address.eq(0x7FFFF),
        ]
        with m.If(~stranger.valid | stranger.ready):
            m.d.sync += stranger.valid.eq(noise[:8] < self.traffic)
        return m


class TwoPassPins(wiring.Component):
    """Mask pixels in, spots out, and the pins of the memory."""

    def __init__(self, width, height, labels):
        self.labelling = TwoPassLabelling(width, height, labels)
        super().__init__({
            "i": In(stream.Signature(MaskPixel)),
            "o": Out(stream.Signature(Spot)),
            "dropped": Out(16),
            "pins": Out(SRAMPins()),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.labelling = labelling = self.labelling
        m.submodules.port = port = SRAMPort()
        connect(m, labelling.command, port.command[0])
        connect(m, port.answer[0], labelling.answer)
        connect(m, flipped(self.i), labelling.i)
        connect(m, labelling.o, flipped(self.o))
        connect(m, port.pins, flipped(self.pins))
        m.d.comb += self.dropped.eq(labelling.dropped)
        return m
