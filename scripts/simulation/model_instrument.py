"""The whole instrument as golden models: the same commands and octets as the RTL's, at video rate.

It has the members of :class:`scripts.simulation.emulator.Emulator` that a terminal wants. Left out
is what takes time in the chip: everything of a pair of frames is there at the end of the pair, and
the line is only as long as a pair has octets.
"""

from dataclasses import replace

from hdl.protocol import Command, Mode, tables
from model.capsule import Capsule
from model.link.commands import CommandMachine
from model.link.framer import frame as wire_packets
from model.link.framer import wire_octets
from model.link.points import packets
from model.link.texture import Texture, TextureFrame
from model.link.texture_code import BOUNDS
from model.settings import Settings

__all__ = ["ModelInstrument"]

_BITS = 10  # of a character on the line
_LANES = 2


class ModelInstrument:
    """The chip as its host sees it.

    Parameters
    ----------
    expose : callable
        Given the times of a pattern (``pattern_us`` of light) and a texture in microseconds, and
        whether the laser is lit: the two images, arrays (height, width) of uint8.
    width, height, beams : :class:`int`
        Of sensor and mesh.
    baud : :class:`int`
        Speed of the line.

    Attributes
    ----------
    tripped : :class:`int`
        Causes that the laser guard holds, bits of :data:`hdl.protocol.GUARD_CAUSES`.
    """

    def __init__(self, expose, width, height, beams, baud=115_200):
        self._expose, self._size, self._baud = expose, (width, height), baud
        self.machine = CommandMachine(width, height, beams, _LANES, baud=baud)
        self._texture = Texture(width, height)
        self._model, self._out, self._sequence = None, bytearray(), 0
        self._patterns, self._owed = 0, 0.0  # since the last that was measured; octets on the line
        self._number, self._now, self._next, self._capture_until = 0, 0.0, 0.0, 0.0
        self.tripped = 0

    @property
    def unsent(self):
        """Octets from the host that have not gone over the line yet."""
        return 0

    def send(self, octets):
        """Octets from the host."""
        machine = self.machine
        capture = self._now < self._capture_until
        machine.capture *= capture
        machine.status["state"] = (machine.tables_valid or capture) << 1
        machine.status["guard_causes"] = self.tripped
        for reply in machine.receive(octets):
            if reply[2] == Command.CAPTURE:  # tag, command and reason follow the kind
                self._capture_until = self._now + 1000 * machine.capture
            self._send([reply])
        if machine.cleared:
            machine.cleared, self.tripped = 0, 0
        if machine.written["mode"] == Mode.STOP:
            machine.acting["mode"] = int(Mode.STOP)
            self._hand_over()

    def run(self, microseconds):
        """Let so much time pass."""
        self._now += microseconds
        while self._next <= self._now:
            self._pair()
            self._next += self.machine.acting["period_us"]

    def receive(self):
        """Octets for the host."""
        octets = bytes(self._out)
        self._out.clear()
        return octets

    def _send(self, contents):
        sent, self._sequence = wire_packets(contents, self._sequence)
        self.machine.status["packets"] = (self.machine.status["packets"] + len(sent)) & 0xFFFF
        self._out += b"".join(sent)

    def _hand_over(self):
        """Registers and tables that were written begin to act."""
        before = self.machine.acting, self.machine.bank
        self.machine.hand_over()
        if (self.machine.acting, self.machine.bank) != before:
            self._model = None

    def _settings(self):
        words = self.machine.tables
        return Settings.from_chip(self.machine.acting, {
            table.name: words.words(table.number, acting=True) for table in tables("capsule")})

    def _pair(self):
        machine = self.machine
        self._hand_over()
        registers = machine.acting
        mode = registers["mode"]
        if mode == Mode.STOP:
            return
        machine.single_done()
        machine.status["pairs"] = (machine.status["pairs"] + 1) & 0xFFFF
        capture = self._now < self._capture_until
        lit = (machine.tables_valid or capture) and not self.tripped
        flags = {"laser": bool(lit), "capture": capture, "tripped": bool(self.tripped),
                 "tables_valid": machine.tables_valid}
        pattern, texture = self._expose(registers["pattern_us"], registers["texture_us"], lit)
        if self._model is None:
            self._model = Capsule(self._settings(), *self._size, registers["points_max"])
        contents = []
        if not 0 < self._patterns < registers["pattern_every"]:
            self._patterns = 0
            frame = replace(
                self._model.frame(pattern), number=self._number, every=registers["pattern_every"],
                exposure_us=registers["pattern_us"],
                timestamp_us=round(self._next) & 0xFFFFFF, **flags)
            contents = packets(frame, bool(registers["full_records"]))
        self._patterns += 1
        room = (registers["period_us"] * self._baud / 1e6 / _BITS - wire_octets(contents)
                - self._owed)
        self._owed = max(0.0, -room)
        if mode != Mode.PATTERN:
            contents += self._image(texture, room, registers, {**flags, "laser": False})
        self._send(contents)
        self._number = (self._number + 2) & 0xFFFF

    def _image(self, image, room, registers, flags):
        """Contents of packets of the texture, as many as there is room for."""
        begin = round(self._next + registers["period_us"] // 2) & 0xFFFFFF
        self._texture.frame(image, TextureFrame(
            (self._number + 1) & 0xFFFF, exposure_us=registers["texture_us"], timestamp_us=begin,
            **flags), BOUNDS[registers["texture_bound"] // 2], bool(registers["texture_mosaic"]))
        contents = []
        while room > 0 and (content := self._texture.packet()) is not None:
            room -= wire_octets([content])
            if registers["texture_enable"] or len(contents) == 0:
                contents.append(content)
        return contents
