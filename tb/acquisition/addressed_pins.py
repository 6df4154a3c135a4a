"""An imager with addressed pixels and a converter, at the pins of a cocotb bench."""

import random

import cocotb
from cocotb.triggers import ReadOnly, RisingEdge

from tb.acquisition.imager_pins import ExposedPins

__all__ = ["AddressedImagerPins", "AddressedPins"]


class AddressedPins:
    """Converts the pixel whose address stands at the pins when ``convert`` is high.

    The result is at ``data`` in one clock only, before and after which there is anything else. A
    pixel whose address has stood for too short a time is converted to anything, too.

    Parameters
    ----------
    dut : cocotb handle
        With the pins ``row``, ``column``, ``convert``, ``data`` and the clock ``clk``; it converts
        only while ``sending`` is high.
    pixels : callable
        Gives the picture (height, width) as it is now.
    latency : :class:`int`
        Clocks from ``convert`` to ``data``.
    settle : :class:`int`
        Clocks for which the address must have stood, that of ``convert`` included.

    Attributes
    ----------
    converted : list of (clock, row, column)
        The clock is counted by this object's own count of clocks.
    """

    def __init__(self, dut, pixels, latency, settle, seed=1):
        self.dut, self.pixels, self.latency, self.settle = dut, pixels, latency, settle
        self.rng = random.Random(f"converter {seed}")
        self.converted, self.clock = [], 0
        cocotb.start_soon(self._run())

    async def _run(self):
        dut, due, stood, before = self.dut, {}, 0, None
        while True:
            if not due and not dut.sending.value:
                await RisingEdge(dut.sending)
                stood, before = 0, None
            else:
                await RisingEdge(dut.clk)
            self.clock += 1
            dut.data.value = due.pop(self.clock, self.rng.randrange(256))
            await ReadOnly()
            address = dut.row.value.to_unsigned(), dut.column.value.to_unsigned()
            stood = stood + 1 if address == before else 1
            before = address
            if dut.convert.value:
                grey = int(self.pixels()[address])
                due[self.clock + self.latency] = (
                    grey if stood >= self.settle else self.rng.randrange(256))
                self.converted.append((self.clock, *address))


class AddressedImagerPins(ExposedPins):
    """The imager model behind such pins; every pixel shows what it has collected by then."""

    def __init__(self, dut, imager, latency, settle, **choices):
        super().__init__(dut, imager, **choices)
        self.taken = []  # (microseconds integrated, microseconds lit, picture)
        self._exposed = None
        self.converter = AddressedPins(dut, self.pixels, latency, settle)
        cocotb.start_soon(self._begin())

    async def _begin(self):
        while True:
            await RisingEdge(self.dut.sensor_read)
            self._exposed = None

    def pixels(self):
        """The picture, exposed anew for each read-out and whenever the pixels have changed."""
        exposed = self.exposed()
        if exposed != self._exposed:
            self._exposed = exposed
            self.taken.append((*exposed, self.imager.expose(*exposed)))
        return self.taken[-1][2]
