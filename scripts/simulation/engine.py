"""The engines of ``cyclope run``: the Verilated RTL without VPI, and the golden model.

Both take frames and give what the link decoder makes of the chip's octets.
"""

import ctypes
import shutil
from dataclasses import replace

import numpy as np

from hdl.config import PRESETS
from hdl.protocol import TABLES
from model.capsule import Capsule as CapsuleModel
from model.errors import UserError
from model.link.framer import frame as framed
from model.link.points import packets
from model.paper import Paper as PaperModel
from model.preprocessing.remap import pack_remap
from scripts.host.decoder import Decoder
from scripts.host.rebuild import Rebuilder
from scripts.simulation.library import build, clocked_verilog, harness
from scripts.simulation.sources import rtl_sources
from scripts.simulation.verilator import verilator_environment

__all__ = ["ModelEngine", "RTLEngine", "open_engine", "preset_of",
           "require_compiler"]

#: Clocks after which a frame that was shown must have come out of the serial pin.
_PATIENCE = 4_000_000


def preset_of(settings):
    """The preset that settings are meant for: only one corrects whole images by a table."""
    return "paper" if settings.remap else "capsule"


class _Engine:
    """Frames in, decoded frames out, one for each in its order."""

    def __init__(self, settings, width, height):
        self.settings = settings
        self.decoder = Decoder(Rebuilder(settings, width, height))
        self._discard = []
        #: A frame's levels follow from the noise of the frame before it.
        self.learns_before = not settings.fixed_noise and preset_of(settings) == "capsule"

    def frames(self, images, independent=False):
        """Decoded frame of every image.

        The preset ``capsule`` learns the noise on the frame before. So the first image is shown
        twice and the answer to its first showing is left out; with ``independent`` so is every
        image. Nothing is repeated where the noise is fixed, or the threshold learnt on the frame
        itself.
        """
        for index, image in enumerate(images):
            if self.learns_before and (independent or index == 0):
                yield from self._show(image, discard=True)
            yield from self._show(image, discard=False)
        yield from self._finish()

    def _show(self, image, discard):
        self._discard.append(discard)
        return self._kept(self._octets(image))

    def _kept(self, octets):
        kept = []
        for frame in self.decoder.feed(octets):
            if not self._discard.pop(0):
                kept.append(frame)
        return kept


class ModelEngine(_Engine):
    """The golden model, frame by frame."""

    def __init__(self, settings, width, height):
        super().__init__(settings, width, height)
        model = {"capsule": CapsuleModel, "paper": PaperModel}[preset_of(settings)]
        self._model = model(settings, width, height)
        self._sequence = 0

    def _octets(self, image):
        contents = packets(self._model.frame(image), full_records=True)
        octets, self._sequence = framed(contents, self._sequence)
        return b"".join(octets)

    def _finish(self):
        return []


def require_compiler(otherwise=""):
    """Raise :class:`UserError` if what builds the RTL is not there.

    Parameters
    ----------
    otherwise : :class:`str`
        What else the user can do, the end of the sentence.
    """
    path = verilator_environment()["PATH"]
    for program, package in (("c++", "a C++ compiler (Debian: g++)"), ("make", "make"),
                             ("perl", "perl"), ("verilator", "Verilator 5.036 or newer")):
        if not shutil.which(program, path=path):
            raise UserError(f"The RTL is built with {package}, which is not installed: install "
                            f"it{otherwise}.")


def _design(config):
    """Class of the chip in ``config``."""
    from hdl.capsule import Capsule
    from hdl.paper import Paper

    return Paper if config.preset == "paper" else Capsule


def _verilog(config):
    """The chip as the harness needs it; pixels and system share a clock."""
    chip = _design(config)(config, clock_gated=True)
    clocks = {"sync": "clk", "pixel": "clk", "spot": "spot_clk"}
    if config.preset == "paper":
        return clocked_verilog(chip, "capsule", {**clocks, "display": "display_clk"},
                               any_edge="display_clk")
    tables = ("table_write", "table_read", "table_select", "table_address", "table_data")
    return clocked_verilog(chip, "capsule", clocks, dict.fromkeys(tables, "spot"))


def _library(config):
    """Path of the shared library of the chip in ``config``; built if it is not there yet."""
    def verilog():
        require_compiler(", or use --engine model, which gives identical points")
        return _verilog(config)

    setters = " ".join(f"X({name})" for name in _design(config).registers)
    return build("capsule", repr(config) + rtl_sources(__file__), verilog,
                 f"#define REGISTERS(X) {setters}\n"
                 + harness("capsule.cpp", config.preset == "paper"))


class RTLEngine(_Engine):
    """The Verilated chip: pixels at the camera's pins, octets from the serial pin.

    Parameters
    ----------
    settings : :class:`model.settings.Settings`
        Registers and tables.
    config : :class:`hdl.config.Config`
        Constructor choices of the RTL.
    line_blanking, frame_blanking : :class:`int`
        Pixel clocks without a pixel, after a line and after a frame.
    full_records : :class:`bool`
        Let the chip send all it knows of every point; else the reader computes beams and depths,
        and holds the frame's check against them.
    """

    def __init__(self, settings, config, line_blanking=0, frame_blanking=16, full_records=True):
        super().__init__(settings, config.width, config.height)
        self.full_records = full_records
        self.config = config
        self.blanking = line_blanking, frame_blanking
        self._library = library = ctypes.CDLL(str(_library(config)))
        library.capsule_new.restype = ctypes.c_void_p
        library.capsule_clocks.restype = ctypes.c_uint64
        library.capsule_octets.restype = ctypes.c_size_t
        library.capsule_set.restype = ctypes.c_bool
        self._handle = ctypes.c_void_p(library.capsule_new())
        self._room = ctypes.create_string_buffer(1 << 20)
        library.capsule_idle(self._handle, ctypes.c_uint64(64))
        self._load(settings)

    def __del__(self):
        if getattr(self, "_handle", None):
            self._library.capsule_free(self._handle)
            self._handle = None

    @property
    def clocks(self):
        """Clocks since the engine was made."""
        return self._library.capsule_clocks(self._handle)

    def _load(self, settings):
        values = {**settings.registers(), "full_records": self.full_records, "divisor": 1}
        for name in values.keys() & _design(self.config).registers.keys():
            if not self._library.capsule_set(
                    self._handle, name.encode(), ctypes.c_uint32(int(values[name]))):
                raise LookupError(f"The simulated chip has no register {name!r}")
        tables = settings.tables()
        for table in TABLES:
            for address, word in enumerate(tables[table.name]):
                parts = (ctypes.c_uint32 * 3)(
                    *(word >> 32 * part & 0xFFFFFFFF for part in range(3)))
                self._library.capsule_write_table(
                    self._handle, table.number, ctypes.c_uint32(address), parts)
        self._library.capsule_swap(self._handle)
        if self.config.preset == "paper":
            from hdl.paper_points import REMAP_BASE

            table = pack_remap(settings.remap).astype(np.uint32)
            self._library.capsule_write_memory(
                self._handle, ctypes.c_uint32(REMAP_BASE), table.ctypes.data_as(ctypes.c_void_p),
                ctypes.c_size_t(len(table)))

    def _octets(self, image):
        image = np.ascontiguousarray(image, dtype=np.uint8)
        if image.shape != (self.config.height, self.config.width):
            raise ValueError(f"A frame must have {self.config.width} x {self.config.height} "
                             f"pixels, not {image.shape[1]} x {image.shape[0]}")
        line, frame = self.blanking
        self._library.capsule_frame(
            self._handle, image.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(image.shape[0]),
            ctypes.c_size_t(image.shape[1]), ctypes.c_size_t(line), ctypes.c_size_t(frame))
        return self._taken()

    def _taken(self):
        count = self._library.capsule_octets(
            self._handle, self._room, ctypes.c_size_t(len(self._room)))
        return ctypes.string_at(self._room, count)

    def _finish(self):
        waited = 0
        while self._discard:
            if waited > _PATIENCE:
                raise RuntimeError(f"{len(self._discard)} frames never left the serial pin")
            self._library.capsule_idle(self._handle, ctypes.c_uint64(4096))
            waited += 4096
            yield from self._kept(self._taken())


def open_engine(kind, calibration, report_rejected=True):
    """An engine that is loaded with ``calibration``.

    Parameters
    ----------
    kind : ``"rtl"`` or ``"model"``
        Verilated RTL, or the golden model.
    calibration : :class:`calibration.file.Calibration`
        Registers, tables and sensor size.
    report_rejected : :class:`bool`
        Let rejected spots through to the reader too.

    Raises
    ------
    UserError
        If the RTL cannot be built here.
    """
    settings = replace(calibration.settings, report_rejected=report_rejected)
    if kind == "model":
        return ModelEngine(settings, calibration.width, calibration.height)
    preset = PRESETS[preset_of(settings)]
    beams = len(settings.line)
    lanes = beams if preset.lanes == preset.beams else min(preset.lanes, beams)
    return RTLEngine(settings, replace(
        preset, width=calibration.width, height=calibration.height, beams=beams, lanes=lanes,
        mean_window=settings.mean_window))
