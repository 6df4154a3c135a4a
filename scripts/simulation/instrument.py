"""The Verilated instrument with an imager in front and a host behind, without VPI."""

import ctypes

import numpy as np

from scripts.simulation.engine import require_compiler
from scripts.simulation.library import EVERY_CLOCK, build, clocked_verilog, harness
from scripts.simulation.sources import rtl_sources

__all__ = ["Instrument", "Line"]

_PICTURE = ctypes.CFUNCTYPE(None, ctypes.c_uint64, ctypes.c_uint64, ctypes.POINTER(ctypes.c_uint8))
_ROOM = 1 << 16


def _library(config):
    def verilog():
        from hdl.instrument import Instrument as RTLInstrument

        require_compiler()
        clocks = {"sync": "clk", "spot": "spot_clk"}
        if config.converter_latency is None:
            clocks["pixel"] = "pixel_clk"
        if paper:
            clocks["display"] = "display_clk"
        return clocked_verilog(
            RTLInstrument(config, clock_gated=True), "instrument", clocks,
            any_edge="display_clk" if paper else EVERY_CLOCK)

    paper = config.preset == "paper"
    text = harness("instrument.cpp", paper)
    if config.converter_latency is not None:
        text = f"#define CONVERTER_LATENCY {config.converter_latency}\n{text}"
    return build("instrument", repr(config) + rtl_sources(__file__), verilog, text)


class Instrument:
    """An instrument that runs for a given time.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices of the RTL.
    picture : callable
        Given the microseconds for which the imager integrated since its reset, and those of them
        in which the laser was lit: what the imager reads out, array (height, width) of uint8.
    pixel_hz : :class:`int`
        Clock of the imager, at most that of the system; addressed pixels need none.
    line_blanking : :class:`int`
        Pixel clocks without a pixel after a line; likewise.
    """

    def __init__(self, config, picture, pixel_hz=8_000_000, line_blanking=0):
        self.config = config
        self._failed = None
        self._library = library = ctypes.CDLL(str(_library(config)))
        for name, result in (("new", ctypes.c_void_p), ("clocks", ctypes.c_uint64),
                             ("unsent", ctypes.c_size_t), ("receive", ctypes.c_size_t),
                             ("framing_errors", ctypes.c_uint64), ("pulses", ctypes.c_size_t)):
            getattr(library, f"instrument_{name}").restype = result
        shape = config.height, config.width
        per_us = config.clock_hz / 1e6

        def read_out(integrated, lit, grey):
            try:
                image = np.asarray(picture(integrated / per_us, lit / per_us))
                if image.shape != shape or image.dtype != np.uint8:
                    raise ValueError(f"A picture must have {shape[1]} x {shape[0]} pixels of 8 "
                                     f"bits, not {image.shape[::-1]} of {image.dtype}")
                np.ctypeslib.as_array(grey, shape)[:] = image
            except BaseException as error:  # must not unwind through C
                self._failed = error

        self._picture = _PICTURE(read_out)  # as long as the library may call it
        self._handle = ctypes.c_void_p(library.instrument_new(
            *map(ctypes.c_size_t, (config.width, config.height, line_blanking)),
            ctypes.c_uint64(pixel_hz), ctypes.c_uint64(config.clock_hz),
            ctypes.c_uint32(round(config.clock_hz / config.baud)), self._picture))
        self._octets = ctypes.create_string_buffer(_ROOM)
        self._stamps = (ctypes.c_uint64 * _ROOM)()
        #: Clock of the start bit of each octet that :meth:`receive` gave last.
        self.stamps = np.zeros(0, np.uint64)

    def __del__(self):
        if getattr(self, "_handle", None):
            self._library.instrument_free(self._handle)
            self._handle = None

    @property
    def clocks(self):
        """System clocks since power-up."""
        return self._library.instrument_clocks(self._handle)

    @property
    def framing_errors(self):
        """Characters on the serial line without a stop bit."""
        return self._library.instrument_framing_errors(self._handle)

    @property
    def unsent(self):
        """Octets from the host that have not gone over the line yet."""
        return self._library.instrument_unsent(self._handle)

    @property
    def pulses(self):
        """First lit and first dark clock of every pulse of the laser, array (pulses, 2).

        A pulse that is still lit has 0 for its end.
        """
        count = self._library.instrument_pulses(self._handle, None, ctypes.c_size_t(0))
        edges = (ctypes.c_uint64 * (count + 1))()
        self._library.instrument_pulses(self._handle, edges, ctypes.c_size_t(count))
        return np.array(edges[:count + count % 2], np.int64).reshape(-1, 2)

    def run(self, microseconds):
        """Let so much time pass."""
        clocks = round(microseconds * self.config.clock_hz / 1e6)
        self._library.instrument_run(self._handle, ctypes.c_uint64(clocks))
        if self._failed:
            error, self._failed = self._failed, None
            raise error

    def send(self, octets):
        """Queue octets from the host."""
        self._library.instrument_send(self._handle, bytes(octets), ctypes.c_size_t(len(octets)))

    def receive(self):
        """Octets that have come since the last call."""
        count = self._library.instrument_receive(
            self._handle, self._octets, self._stamps, ctypes.c_size_t(_ROOM))
        self.stamps = np.array(self._stamps[:count], np.uint64)
        return self._octets.raw[:count]

    def clear_to_send(self, may_send):
        """The line CTS."""
        self._library.instrument_cts(self._handle, int(may_send))

    def fill_memory(self, address, words):
        """Words in the external memory of the preset ``paper``, as a board would load them."""
        words = np.ascontiguousarray(words, dtype=np.uint32)
        self._library.instrument_fill_memory(
            self._handle, ctypes.c_uint32(address), words.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_size_t(len(words)))

    def silence(self, silent):
        """A fault of the imager: it sends no frame while silent."""
        self._require_frames()
        self._library.instrument_silence(self._handle, int(silent))

    def stop_row(self, row):
        """A fault of the imager: the frame ends before this row, once."""
        self._require_frames()
        self._library.instrument_stop_row(self._handle, ctypes.c_size_t(row))

    def short_row(self, row, by):
        """A fault of the imager: this row lacks ``by`` pixels, or has more, once."""
        self._require_frames()
        self._library.instrument_short_row(self._handle, ctypes.c_size_t(row), by)

    def _require_frames(self):
        """Refuse a fault that only an imager has which sends frames by itself."""
        if self.config.converter_latency is not None:
            raise ValueError("An imager with addressed pixels sends no frames by itself, so none "
                             "can be missing, end early or have a row of another length")


class Line:
    """The host's end of an instrument's serial line, in place of :class:`scripts.host.port.Port`.

    The instrument runs while the host reads.

    Parameters
    ----------
    instrument : :class:`Instrument`
        The other end.
    step_us : :class:`float`
        How long it runs with each read.
    """

    def __init__(self, instrument, step_us=500):
        self.instrument, self.step_us = instrument, step_us
        self.name = "the simulated instrument"
        #: All octets that came from the chip.
        self.record = bytearray()

    def write(self, octets):
        """Send octets."""
        self.instrument.send(octets)

    def read(self):
        """Octets that came."""
        self.instrument.run(self.step_us)
        octets = self.instrument.receive()
        self.record += octets
        return octets
