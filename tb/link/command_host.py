"""A host that asks chip and model the same, and compares all that can be seen of both."""

import numpy as np

from hdl.payloads import PacketOctet
from hdl.protocol import CONTENT_LIMIT, Command, Mode, Reason
from model.link.commands import CommandMachine
from model.link.receiver import encode
from tb.link.command_rig import CommandRig
from tb.native_block import NativeBlock

__all__ = ["Host"]

_DATA_LIMIT = CONTENT_LIMIT - 9
_INPUTS = ("guard_causes", "pairs", "timeouts", "bad_sync", "overrun", "skipped", "packets",
           "late", "display")


class Host:
    """The rig and its model side by side.

    ``idle``: the rig's ``idle``, with which registers act at once while stopped.
    """

    def __init__(self, width=64, height=48, beams=3, lanes=2, preset="capsule",
                 clock_hz=1_000_000, baud=115_200):
        self.rig = CommandRig(width, height, beams, lanes, preset, clock_hz, baud)
        self.block = NativeBlock(self.rig)
        self.block.reset()
        self.model = CommandMachine(width, height, beams, lanes, preset, clock_hz, baud)
        self.writes = 0
        self.idle = False
        self.block.set(ready=1)
        self.stall = 0.0
        self.seed = 0

    def set(self, idle=None, ready=None, laser_armed=None, sensor_silent=None, **inputs):
        """Inputs of the chip, and what the model must know of them."""
        if idle is not None:
            self.idle = bool(idle)
            self.block.set(idle=int(idle))
        if ready is not None:
            self.model.ready = bool(ready)
            self.block.set(ready=int(ready))
        state = self.model.status["state"]
        for name, bit, value in (("laser_armed", 1, laser_armed), ("sensor_silent", 7,
                                                                   sensor_silent)):
            if value is not None:
                self.block.set(**{name: int(value)})
                state = state & ~(1 << bit) | int(value) << bit
        self.model.status["state"] = state
        self.block.set(**inputs)
        self.model.status.update(inputs)
        self.wait(3)
        self._settle()

    def _settle(self):
        if self.idle and Mode.STOP in (self.model.acting["mode"], self.model.written["mode"]):
            self.model.hand_over()

    def wait(self, clocks):
        """Let time pass; nothing may come from the chip."""
        beats = self.block.stream(np.zeros((0, 1), np.uint32), idle=clocks)
        assert not len(beats.words)

    def pulse(self, *names):
        """Inputs that are high for a clock."""
        self.block.set(**dict.fromkeys(names, 1))
        self.wait(1)
        self.block.set(**dict.fromkeys(names, 0))
        # In one clock, it is the mode before that is done.
        if "single_done" in names:
            self.model.single_done()
        if "apply" in names:
            self.model.hand_over()
        self.wait(2)
        self._settle()

    def send(self, octets, clocks=None):
        """Octets to both; the replies, the same of both."""
        octets = bytes(octets)
        clocks = 2000 if clocks is None else clocks
        self.seed += 1
        words = np.frombuffer(octets, np.uint8).astype(np.uint32)[:, None]
        beats = self.block.stream(words, idle=clocks, stall=self.stall, seed=self.seed)
        fields = beats.fields(PacketOctet)
        data, ends = bytes(fields["data"].astype(np.uint8)), np.flatnonzero(fields["last"]) + 1
        assert not len(data) or (len(ends) and ends[-1] == len(data)), data.hex(" ")
        got = [data[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]
        self.clocks = beats.clocks - beats.taken[-1] if len(beats.taken) else beats.clocks
        return got

    def ask(self, command, data=b"", tag=0x5A):
        """Send a command; reason and data of the reply, the same of both. Checks everything."""
        content = bytes([command, tag]) + bytes(data)
        slow = self.rig.commands.commit_clocks() if command == Command.COMMIT else 0
        got = self.send(encode(content), 2000 + slow)
        wanted = [self.model.reply(content)]
        assert got == wanted, f"{content.hex(' ')}: {[reply.hex(' ') for reply in got]}"
        if wanted[0][3] == Reason.OK and command == Command.TABLE:
            self.writes += (len(data) - 3) // self.model.kinds[data[0]].octets
        self._settle()
        self.compare()
        return Reason(wanted[0][3]), wanted[0][4:]

    def damaged(self, octets, clocks=None):
        """Send octets that may be damaged; the replies are the model's."""
        got, wanted = self.send(octets, clocks), self.model.receive(octets)
        assert got == wanted, f"{bytes(octets).hex(' ')}: {got}"
        self._settle()
        self.compare()
        return wanted

    def compare(self):
        """All outputs that stand still."""
        model, get = self.model, self.block.get
        for register in model.registers.values():
            mask = (1 << register.bits) - 1
            want = model.acting[register.name] & mask
            got = get(register.name)
            assert got == want, f"{register.name} is {got:#x}, not {want:#x}"
        assert get("bank") == model.bank and get("tables_valid") == model.tables_valid
        assert get("stop") == (model.written["mode"] == Mode.STOP)
        assert get("capture") == bool(model.capture)
        assert get("clears") == model.cleared & 0xFF and get("writes") == self.writes & 0xFFFF
        assert not get("wrong")

    def write(self, name, value):
        address = next(a for a, r in self.model.registers.items() if r.name == name)
        return self.ask(Command.WRITE, bytes([address]) + (value & 0xFFFFFFFF).to_bytes(
            4, "little"))[0]

    def begin(self):
        *sizes, version = self.model._sensor
        return self.ask(Command.BEGIN, b"".join(size.to_bytes(2, "little") for size in sizes)
                        + bytes([version]))[0]

    def load(self, number, words, first=0):
        """Words of a table, in as many packets as they take."""
        table = self.model.kinds[number]
        step = _DATA_LIMIT // table.octets
        for at in range(0, len(words), step):
            octets = b"".join(int(word).to_bytes(table.octets, "little")
                              for word in words[at:at + step])
            reason, _ = self.ask(Command.TABLE, bytes([number]) + (first + at).to_bytes(
                2, "little") + octets)
            if reason:
                return reason
        return Reason.OK

    def commit(self, checks=None):
        checks = self.model.checks() if checks is None else checks
        return self.ask(Command.COMMIT, b"".join(c.to_bytes(4, "little") for c in checks))[0]

    def read_everything(self):
        """Status, every register, and every word of the tables that can be read."""
        self.ask(Command.STATUS)
        for address in self.model.registers:
            self.ask(Command.READ, [address])
        if self.model.committed or not self.model.ready:
            return
        for table, count in zip(self.model.kinds, self.model.counts, strict=True):
            step = _DATA_LIMIT // table.octets
            for first in range(0, count, step):
                self.ask(Command.READ_TABLE, bytes([table.number]) + first.to_bytes(2, "little")
                         + bytes([min(step, count - first)]))
