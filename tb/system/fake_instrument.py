"""An instrument in Python: it answers commands as the chip does and measures with the model.

It has the same three members as the Verilated one: ``send``, ``run``, ``receive``.
"""

import zlib

import numpy as np

from calibration.file import Beam, Calibration
from calibration.lens import Lens
from calibration.projector import Projector
from hdl.protocol import PROTOCOL_VERSION, TABLE_VERSION, TABLES, Command, Mode, Reason
from model.capsule import Capsule
from model.link.commands import CommandMachine
from model.settings import Settings
from tb.link.wire import Wire, make_frame
from tb.system.stimuli import any_settings, spot_frame

__all__ = ["FakeInstrument", "any_calibration", "images"]

PAIR_US = 40_000
_RADIAL = next(table.number for table in TABLES if table.name == "radial")


def any_calibration(width=64, height=64, rows=3, columns=3, seed=1, **changes):
    """A calibration that fits the sensor, though no real rig made it."""
    settings = any_settings(width, height, rows * columns, seed, report_rejected=False,
                            fixed_noise=160, **changes)
    lens = Lens(width, height, 0.85 * width, (width - 1) / 2 + 1.3, (height - 1) / 2 - 0.7, -0.12,
                0.02, 5e-4, -4e-4)
    beam = Beam(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, None, 0.0, 0.0, 1.0, 2)
    return Calibration(lens, Projector(rows, columns, 5.0, 2.0, 0.0, (5.0, 0.0, 0.0)),
                       (beam,) * (rows * columns), settings, 1e-6, 5.0, 50.0, {})


def images(count=8, width=64, height=64):
    """Pattern frames that :func:`any_calibration` finds points in."""
    return [spot_frame(width, height, seed, spots=30) for seed in range(count)]


def _unstuffed(piece):
    """COBS undone; what is not COBS gives something that no check passes."""
    out, place = b"", 0
    while place < len(piece):
        step = piece[place]
        out += piece[place + 1:place + step] + b"\0"
        place += step
    return out[:-1]


class FakeInstrument:
    """The chip as its host sees it.

    Commands are carried out by :class:`model.link.commands.CommandMachine`; what was written acts
    at the next pair, or at once while the chip is stopped.

    Parameters
    ----------
    shown : list of array (height, width)
        Pattern frames, over and over; all are of one size.
    beams : :class:`int`
        Beams of the chip.
    texture : array (height, width) or None
        What texture frames show.
    protocol, tables : :class:`int`
        Versions that it claims.

    Attributes
    ----------
    noise : :class:`float`
        Probability that a bit to the host is turned over.
    deaf : :class:`int`
        So many of the next commands are lost.
    damaging : :class:`int`
        So many of the next commands arrive damaged.
    mute : :class:`int`
        So many of the next commands are carried out without an answer.
    busy : :class:`int`
        So many of the next commands find the chip busy.
    forgetful : :class:`bool`
        A bit of the radial table's memory is stuck.
    guard_causes : :class:`int`
        Causes that the laser guard holds.
    """

    def __init__(self, shown, beams=9, texture=None, protocol=PROTOCOL_VERSION,
                 tables=TABLE_VERSION):
        self.shown, self.beams, self.texture = shown, beams, texture
        self.height, self.width = shown[0].shape
        self.noise, self.forgetful = 0.0, False
        self.deaf = self.damaging = self.mute = self.busy = 0
        self.machine = CommandMachine(self.width, self.height, beams, 2,
                                      versions=(protocol, tables))
        self.counters = self.machine.status
        self.counters.update(timeouts=1, bad_sync=2, overrun=3, skipped=4, framing=5)
        self.guard_causes = self.capture_until = 0
        self.number, self.now, self._next = 0, 0, 0
        self._wire, self._pending, self._out = Wire(), b"", b""
        self._row, self._model, self._rng = 0, None, np.random.default_rng(1)

    @property
    def registers(self):
        """Values of the registers as they act."""
        return self.machine.acting

    @property
    def valid(self):
        """Whether a set of tables was committed and checked."""
        return self.machine.tables_valid

    def pattern(self, number):
        """Which of the images frame ``number`` is."""
        return number // 2 % len(self.shown)

    def send(self, octets):
        """Octets from the host."""
        *pieces, self._pending = (self._pending + octets).split(b"\0")
        for piece in filter(None, pieces):
            self._take(_unstuffed(piece))

    def run(self, microseconds):
        """Let so much time pass."""
        self.now += microseconds
        while self._next <= self.now:
            self._pair()
            self._next += PAIR_US

    def receive(self):
        """Octets for the host."""
        octets, self._out = self._out, b""
        if self.noise and octets:
            flips = self._rng.random(8 * len(octets)) < self.noise
            octets = (np.frombuffer(octets, np.uint8) ^ np.packbits(flips)).tobytes()
        return octets

    def _pair(self):
        self._hand_over()
        mode = self.registers["mode"]
        if mode == Mode.STOP:
            return
        self.machine.single_done()
        self.counters["pairs"] += 1
        capture = self.now < self.capture_until
        lit = self.valid or capture
        state = capture << 4 | bool(self.guard_causes) << 5 | self.valid << 6
        if self._model is None:
            self._model = Capsule(self._settings(), self.width, self.height)
        seen = self._model.frame(self.shown[self.pattern(self.number)])
        frame = make_frame(
            seen.points, self.number, rejected=seen.rejected, level=int(seen.level),
            grey_noise=seen.grey_noise, saturated=seen.saturated,
            exposure_us=self.registers["pattern_us"], timestamp_us=self._next,
            flags=int(seen.learning) << 1 | lit << 3 | state)
        self._send(self._wire.frame(frame, bool(self.registers["full_records"])))
        if mode != Mode.PATTERN:
            self._send_texture(self.number + 1, state | 0x80)
        self.number = (self.number + 2) & 0xFFFF

    def _send_texture(self, number, flags):
        self._send([self._wire.texture_frame(
            number, exposure_us=self.registers["texture_us"],
            timestamp_us=self._next + 20_000, flags=flags)])
        if self.texture is None or not self.registers["texture_enable"]:
            return
        for _ in range(8):
            self._send(self._wire.texture(number, self._row, 0, self.texture[self._row].tolist()))
            self._row = (self._row + 1) % self.height

    def _send(self, packets):
        for packet in packets:
            self._out += packet
            self.counters["packets"] = (self.counters["packets"] + 1) & 0xFFFF

    def _settings(self):
        tables = self.machine.tables
        return Settings.from_chip(self.registers, {
            table.name: tables.words(table.number, acting=True) for table in tables.kinds})

    def _hand_over(self):
        """Registers and tables that were written begin to act."""
        before = self.machine.acting, self.machine.bank
        self.machine.hand_over()
        if (self.machine.acting, self.machine.bank) != before:
            self._model = None

    def _take(self, content):
        """The content of a packet from the host, with its check."""
        if self.deaf:
            self.deaf -= 1
            return
        body, check = content[:-4], content[-4:]
        if self.damaging or zlib.crc32(body).to_bytes(4, "little") != check or len(body) < 2:
            self.damaging = max(0, self.damaging - 1)
            self.counters["damaged"] += 1
            self._send([self._wire.reply(0, 0, Reason.DAMAGED_PACKET)])
            return
        command, tag = body[:2]
        if self.busy:
            self.busy -= 1
            self.counters["refused"] += 1
            reason, answer = Reason.BUSY, b""
        else:
            reason, answer = self._carry_out(command, body)
        if self.mute:
            self.mute -= 1
            return
        self._send([self._wire.reply(tag, command, reason, answer)])

    def _carry_out(self, command, body):
        """Reason and data of the reply."""
        machine = self.machine
        capture = self.now < self.capture_until
        machine.capture *= capture
        self.counters["state"] = (self.valid or capture) << 1
        self.counters["guard_causes"] = self.guard_causes
        reply = machine.reply(body)
        if command == Command.CAPTURE:
            self.capture_until = self.now + 1000 * machine.capture
        elif command == Command.CLEAR:
            self.guard_causes = 0
        if self.forgetful:
            machine.tables.words(_RADIAL)[100] |= 1
        if self.registers["mode"] == Mode.STOP:
            self._hand_over()
        return reply[3], reply[4:]
