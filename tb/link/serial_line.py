"""The framer with its transmitter: packets in, the serial pin out."""

from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from hdl.link.framer import Framer
from hdl.link.uart_tx import UARTTransmitter
from hdl.payloads import PacketOctet

__all__ = ["SerialLine"]


class SerialLine(wiring.Component):
    """``i`` to ``tx``; the other members are the framer's."""

    def __init__(self):
        super().__init__({
            "i": In(stream.Signature(PacketOctet)),
            "divisor": In(16),
            "cts": In(1),
            "tx": Out(1, init=1),
            "busy": Out(1),
        })

    def elaborate(self, platform):
        m = Module()
        m.submodules.framer = framer = Framer()
        m.submodules.uart_tx = uart_tx = UARTTransmitter()
        connect(m, flipped(self.i), framer.i)
        connect(m, framer.o, uart_tx.i)
        m.d.comb += [
            framer.divisor.eq(self.divisor),
            framer.cts.eq(self.cts),
            uart_tx.divisor.eq(self.divisor),
            self.tx.eq(uart_tx.tx),
            self.busy.eq(framer.busy),
        ]
        return m
