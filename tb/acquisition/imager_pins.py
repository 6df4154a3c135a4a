"""The imager model at the pins of a cocotb bench, on a pixel clock of its own."""

import cocotb
from cocotb.simtime import get_sim_time
from cocotb.triggers import ReadOnly, RisingEdge, ValueChange

from model.optics.imager import Charge
from tb.harness import start_clock

__all__ = ["ExposedPins", "ImagerPins"]


class ExposedPins:
    """What reset, integration and laser do to an imager's pixels.

    The laser has an AC-coupled driver: each change of its pin lights it for ``hold_ps``, and a pin
    that stands still at any level leaves it dark.

    Parameters
    ----------
    dut : cocotb handle
        With the pins ``sensor_reset``, ``sensor_integrate``, ``sensor_read`` and, if there is one,
        ``laser``.
    imager : :class:`model.optics.imager.Imager`
        Sees to the picture.
    hold_ps : :class:`int`
        How long one change of the laser's pin gives light; about a system clock.
    """

    def __init__(self, dut, imager, hold_ps=62_500):
        self.dut, self.imager, self.hold_ps = dut, imager, hold_ps
        self.charge = Charge()
        self._dark_at = None  # when the laser goes out
        cocotb.start_soon(self._watch(dut.sensor_reset, "reset"))
        cocotb.start_soon(self._watch(dut.sensor_integrate, "integrate"))
        if hasattr(dut, "laser"):
            cocotb.start_soon(self._light(dut.laser))

    def exposed(self, **levels):
        """Microseconds integrated and lit up to now, a pin having changed to a new level."""
        now = round(get_sim_time("ps"))
        if self._dark_at is not None and self._dark_at <= now:
            self.charge.at(self._dark_at, laser=0)
            self._dark_at = None
        return tuple(time / 1_000_000 for time in self.charge.at(now, **levels))

    async def _watch(self, pin, name):
        while True:
            await ReadOnly()
            self.exposed(**{name: int(pin.value)})
            await ValueChange(pin)

    async def _light(self, pin):
        while True:
            await ValueChange(pin)
            self.exposed(laser=1)
            self._dark_at = round(get_sim_time("ps")) + self.hold_ps


class ImagerPins(ExposedPins):
    """An imager that sends what it has collected after each rise of ``sensor_read``.

    The pixels hold their charge while they are read, and there is no other store: a reset or an
    integration meanwhile spoils the rows that have not been read yet. A rise of ``sensor_read``
    during a frame is ignored.

    Parameters
    ----------
    dut, imager, hold_ps
        See :class:`ExposedPins`; ``dut`` has the pins ``pixel_clk``, ``frame_valid``,
        ``line_valid`` and ``data`` besides.
    pixel_ps : :class:`int`
        Period of the pixel clock, which is driven here.
    blanking : :class:`int`
        Pixel clocks between two lines, 0 to 48.
    delay : :class:`int`
        Pixel clocks from ``sensor_read`` to ``frame_valid``.

    Attributes
    ----------
    taken : list
        For each frame (microseconds integrated, microseconds lit) as its read-out began, and the
        picture that was sent.
    silent : :class:`bool`
        Send nothing.
    stop_at : :class:`int` or None
        Stop for good before this row, with ``frame_valid`` high, until a reset or None.
    """

    def __init__(self, dut, imager, pixel_ps=125_000, blanking=48, delay=8, **choices):
        if not 0 <= blanking <= 48:
            raise ValueError(f"Line blanking must be 0 to 48 pixel clocks, not {blanking!r}")
        self.blanking, self.delay = blanking, delay
        self.taken, self.silent, self.stop_at, self.sending = [], False, None, False
        dut.frame_valid.value, dut.line_valid.value, dut.data.value = 0, 0, 0
        super().__init__(dut, imager, **choices)
        start_clock(dut.pixel_clk, pixel_ps)
        cocotb.start_soon(self._read())

    async def _read(self):
        while True:
            await RisingEdge(self.dut.sensor_read)
            if not self.sending and not self.silent:
                self.sending = True
                cocotb.start_soon(self._send())

    async def _clocks(self, number):
        for _ in range(number):
            await RisingEdge(self.dut.pixel_clk)

    async def _send(self):
        dut = self.dut
        exposed = self.exposed()
        image = self.imager.expose(*exposed)
        self.taken.append((*exposed, image))
        await self._clocks(self.delay)
        dut.frame_valid.value = 1
        for row in range(self.imager.height):
            if row == self.stop_at:
                await self._stopped()
                break
            if row and self.blanking:
                dut.line_valid.value, dut.data.value = 0, 0xA5
                await self._clocks(self.blanking)
            now = self.exposed()
            if now != exposed:
                exposed = now
                image[row:] = self.imager.expose(*now)[row:]
            dut.line_valid.value = 1
            for grey in image[row].tolist():
                dut.data.value = grey
                await RisingEdge(dut.pixel_clk)
        dut.line_valid.value = 0
        await self._clocks(2)
        dut.frame_valid.value = 0
        await self._clocks(2)
        self.sending = False

    async def _stopped(self):
        self.dut.line_valid.value = 0
        while self.stop_at is not None and not self.dut.sensor_reset.value:
            await RisingEdge(self.dut.pixel_clk)
