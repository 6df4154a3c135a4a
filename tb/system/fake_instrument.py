"""An instrument in Python: it answers commands as the chip does and measures with the model.

It has the same three members as the Verilated one: ``send``, ``run``, ``receive``.
"""

import zlib

import numpy as np

from calibration.file import Beam, Calibration
from calibration.lens import Lens
from calibration.projector import Projector
from hdl.protocol import TABLES, Command, Mode, Reason, registers
from model.capsule import Capsule
from model.settings import EROSION_MODES, Settings
from tb.link.wire import Wire, make_frame
from tb.system.stimuli import any_settings, spot_frame

__all__ = ["FakeInstrument", "any_calibration", "images"]

PAIR_US = 40_000
_REGISTERS = {register.address: register for register in registers()}
_TABLES = {table.number: table for table in TABLES}
_MASK_36 = (1 << 36) - 1


def any_calibration(width=64, height=64, rows=3, columns=3, seed=1, **changes):
    """A calibration that fits the sensor, though no real rig made it."""
    settings = any_settings(width, height, rows * columns, seed, report_rejected=False,
                            level_fixed=60, **changes)
    lens = Lens(width, height, 0.85 * width, (width - 1) / 2 + 1.3, (height - 1) / 2 - 0.7, -0.12,
                0.02, 5e-4, -4e-4)
    beam = Beam(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, None, 0.0, 0.0, 2)
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

    Parameters
    ----------
    shown : list of array (height, width)
        Pattern frames, over and over; all are of one size.
    beams : :class:`int`
        Beams of the chip.
    texture : array (height, width) or None
        What texture frames show.

    Attributes
    ----------
    noise : :class:`float`
        Probability that a bit to the host is turned over.
    deaf : :class:`int`
        So many of the next commands are not heard.
    damaging : :class:`int`
        So many of the next commands arrive damaged.
    mute : :class:`int`
        So many of the next commands are carried out without an answer.
    busy : :class:`int`
        So many of the next commands find the chip busy.
    forgetful : :class:`bool`
        A bit of the radial table's memory is stuck.
    """

    def __init__(self, shown, beams=9, texture=None, protocol=3, tables=1):
        self.shown, self.beams, self.texture = shown, beams, texture
        self.height, self.width = shown[0].shape
        self.versions = protocol, tables
        self.noise, self.forgetful = 0.0, False
        self.deaf = self.damaging = self.mute = self.busy = 0
        self.registers = {name.name: name.reset for name in _REGISTERS.values()}
        self.counters = dict.fromkeys(("commands", "refused", "damaged", "pairs", "packets"), 0)
        self.guard_causes = self.capture_until = 0
        self.tables = {table.name: [0] * table.count(beams, 0) for table in TABLES}
        self._new = {name: list(words) for name, words in self.tables.items()}
        self._begun = self._committed = self.valid = False
        self._bank, self.number, self.now, self._next = 0, 0, 0, 0
        self._wire, self._pending, self._out = Wire(), b"", b""
        self._row, self._model, self._rng = 0, None, np.random.default_rng(1)

    def pattern(self, number):
        """Which of the images frame ``number`` is."""
        return number // 2 % len(self.shown)

    def send(self, octets):
        """Octets from the host."""
        *pieces, self._pending = (self._pending + octets).split(b"\0")
        for piece in filter(None, pieces):
            self._hear(_unstuffed(piece))

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
        if self._committed:
            self._committed, self.valid = False, True
            self.tables = {name: list(words) for name, words in self._new.items()}
            self._bank ^= 1
            self._model = None
        mode = self.registers["mode"]
        if mode == Mode.STOP:
            return
        if mode == Mode.SINGLE:
            self.registers["mode"] = Mode.STOP
        self.counters["pairs"] += 1
        capture = self.now < self.capture_until
        lit = self.valid or capture
        state = capture << 4 | bool(self.guard_causes) << 5 | self.valid << 6
        if self._model is None:
            self._model = Capsule(self._settings(), self.width, self.height)
        seen = self._model.frame(self.shown[self.pattern(self.number)])
        frame = make_frame(
            seen.points, self.number, rejected=seen.rejected, level=int(seen.level),
            exposure_us=self.registers["pattern_us"], timestamp_us=self._next,
            flags=int(seen.learning) << 1 | lit << 3 | state)
        self._send(self._wire.frame(frame, bool(self.registers["full_records"])))
        if mode != Mode.PATTERN:
            number = self.number + 1
            self._send([self._wire.texture_frame(
                number, exposure_us=self.registers["texture_us"],
                timestamp_us=self._next + 20_000, flags=state | 0x80)])
            if self.texture is not None and self.registers["texture_enable"]:
                for _ in range(8):
                    for column in range(0, self.width, 86):
                        self._send([self._wire.texture(
                            number, self._row, column,
                            self.texture[self._row, column:column + 86].tobytes())])
                    self._row = (self._row + 1) % self.height
        self.number = (self.number + 2) & 0xFFFF

    def _send(self, packets):
        for packet in packets:
            self._out += packet
            self.counters["packets"] = (self.counters["packets"] + 1) & 0xFFFF

    def _settings(self):
        values = dict(self.registers)
        fixed = values["threshold_level"] if values["threshold_fixed"] else None
        return Settings(
            level_fixed=fixed, threshold_alpha=values["threshold_alpha"],
            erosion=EROSION_MODES[values["erosion_mode"]],
            weighted=bool(values["weighted"]), report_rejected=bool(values["report_rejected"]),
            radial=tuple(self.tables["radial"]), reciprocal=tuple(self.tables["reciprocal"]),
            depth=tuple(self.tables["depth"]),
            line=tuple(word & _MASK_36 for word in self.tables["beams"]),
            window=tuple(word >> 36 for word in self.tables["beams"]),
            **{name: values[name] for name in (
                "area_min", "area_max", "principal_u", "principal_v", "tangential_1",
                "tangential_2")})

    def _hear(self, content):
        if self.deaf:
            self.deaf -= 1
            return
        body, check = content[:-4], content[-4:]
        if self.damaging or zlib.crc32(body).to_bytes(4, "little") != check or len(body) < 2:
            self.damaging = max(0, self.damaging - 1)
            self.counters["damaged"] += 1
            self._send([self._wire.reply(0, 0, Reason.DAMAGED_PACKET)])
            return
        command, tag, data = body[0], body[1], body[2:]
        if self.busy:
            self.busy -= 1
            reason, answer = Reason.BUSY, b""
        else:
            reason, answer = self._carry_out(command, data)
        self.counters["refused" if reason else "commands"] += 1
        if self.mute:
            self.mute -= 1
            return
        self._send([self._wire.reply(tag, command, reason, answer)])

    def _carry_out(self, command, data):
        """Reason and data of the answer."""
        lengths = {Command.IDENTIFY: 0, Command.WRITE: 5, Command.READ: 1, Command.BEGIN: 6,
                   Command.COMMIT: 16, Command.READ_TABLE: 4, Command.STATUS: 0,
                   Command.CAPTURE: 2, Command.CLEAR: 0}
        if command == Command.TABLE:
            if len(data) < 4:
                return Reason.WRONG_LENGTH, b""
        elif command not in lengths:
            return Reason.UNKNOWN_COMMAND, b""
        elif len(data) != lengths[command]:
            return Reason.WRONG_LENGTH, b""
        answer = getattr(self, "_" + Command(command).name.lower())(data)
        return answer if isinstance(answer, tuple) else (Reason.OK, answer or b"")

    def _identify(self, _):
        protocol, tables = self.versions
        return (bytes([protocol, tables]) + self.width.to_bytes(2, "little")
                + self.height.to_bytes(2, "little") + bytes([self.beams, 2, 0])
                + (16_000).to_bytes(2, "little"))

    def _write(self, data):
        register = _REGISTERS.get(data[0])
        if register is None:
            return Reason.UNKNOWN_REGISTER, b""
        value = int.from_bytes(data[1:], "little", signed=register.signed)
        half = 1 << register.bits - 1
        low, high = (-half, half - 1) if register.signed else (register.low, 2 * half - 1)
        if not low <= value <= (high if register.high is None else register.high):
            return Reason.OUT_OF_RANGE, b""
        self.registers[register.name] = value
        self._model = None
        return b""

    def _read(self, data):
        register = _REGISTERS.get(data[0])
        if register is None:
            return Reason.UNKNOWN_REGISTER, b""
        return (self.registers[register.name] & 0xFFFFFFFF).to_bytes(4, "little")

    def _begin(self, data):
        if data != (self.width.to_bytes(2, "little") + self.height.to_bytes(2, "little")
                    + bytes([self.beams, self.versions[1]])):
            return Reason.OTHER_SENSOR, b""
        self._begun = True
        return b""

    def _span(self, data):
        """Table and first word, or a refusal."""
        table = _TABLES.get(data[0])
        if table is None:
            return None, 0
        return table, int.from_bytes(data[1:3], "little")

    def _table(self, data):
        table, first = self._span(data)
        if not self._begun:
            return Reason.NO_BEGIN, b""
        if table is None:
            return Reason.UNKNOWN_TABLE, b""
        count, rest = divmod(len(data) - 3, table.octets)
        if rest:
            return Reason.WRONG_LENGTH, b""
        if first + count > table.count(self.beams, 0):
            return Reason.OUT_OF_RANGE, b""
        if not table.banked and self.registers["mode"] != Mode.STOP:
            return Reason.NOT_STOPPED, b""
        for at in range(count):
            place = 3 + at * table.octets
            word = int.from_bytes(data[place:place + table.octets], "little")
            self._new[table.name][first + at] = word | (
                self.forgetful and table.name == "radial" and first + at == 100)
        return b""

    def _read_table(self, data):
        table, first = self._span(data)
        if table is None:
            return Reason.UNKNOWN_TABLE, b""
        if first + data[3] > table.count(self.beams, 0) or data[3] * table.octets > 88:
            return Reason.OUT_OF_RANGE, b""
        return b"".join(word.to_bytes(table.octets, "little")
                        for word in self._new[table.name][first:first + data[3]])

    def _commit(self, data):
        if not self._begun:
            return Reason.NO_BEGIN, b""
        for table in TABLES:
            octets = b"".join(word.to_bytes(table.octets, "little")
                              for word in self._new[table.name])
            if zlib.crc32(octets).to_bytes(4, "little") != data[4 * table.number:][:4]:
                return Reason.DAMAGED_TABLE, b""
        self._begun, self._committed = False, True
        return b""

    def _status(self, _):
        capture = self.now < self.capture_until
        state = (self.valid | (self.valid or capture) << 1 | capture << 2 | self._committed << 3
                 | self._bank << 4 | self.registers["mode"] << 5)
        counters = self.counters
        return (bytes([state, self.guard_causes]) + counters["pairs"].to_bytes(2, "little")
                + bytes([1, 2, 3, 4]) + b"".join(
                    counters[name].to_bytes(2, "little")
                    for name in ("commands", "refused", "damaged"))
                + bytes([5]) + counters["packets"].to_bytes(2, "little") + bytes(2))

    def _capture(self, data):
        self.capture_until = self.now + 1000 * int.from_bytes(data, "little")

    def _clear(self, _):
        self.guard_causes = 0
