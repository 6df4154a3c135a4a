# amaranth: UnusedElaboratable=no
import random

import pytest

from hdl.export import to_verilog
from hdl.link.commands import Commands
from hdl.protocol import GUARD_CAUSES, Command, Mode, Reason, tables
from model.link.receiver import encode
from scripts.rtl.size import measure_verilog
from tb.hdlsim import run
from tb.link.command_host import Host
from tb.link.command_rig import CommandRig

SENSOR = bytes([64, 0, 48, 0, 3, 0, 1])
NUMBERS = {table.name: table.number for table in tables("paper")}
RECIPROCAL, RADIAL, BEAMS, REMAP = (
    NUMBERS[name] for name in ("reciprocal", "radial", "beams", "remap"))


@pytest.mark.parametrize("gap,stall", [(0.0, 0.0), (0.5, 0.0), (0.0, 0.9)])
@pytest.mark.parametrize("seed", [1])
def test_commands(request, gap, stall, seed):
    rig = CommandRig(64, 48, 3, 2, clock_hz=1_000_000)
    run(request, "command_rig", "tb.link.tb_commands", component=rig, parameters={
        "gap": gap, "stall": stall, "seed": seed, "commit_clocks": rig.commands.commit_clocks()})


def random_words(rng, table, count):
    return [rng.choice([0, (1 << table.bits) - 1, rng.getrandbits(table.bits)])
            for _ in range(count)]


def random_command(rng, host):
    """A command and its data: most of them well made, all of them sometimes not."""
    model = host.model
    command = rng.choice([*Command, *[Command.TABLE, Command.WRITE, Command.READ_TABLE] * 3])
    table = rng.choice(model.kinds)
    count = model.counts[table.number]
    first = rng.choice([0, rng.randrange(count), count - 1, count, rng.getrandbits(16)])
    number = table.number if rng.random() < 0.95 else rng.getrandbits(8)
    if command == Command.WRITE:
        register = rng.choice(list(model.registers.values()))
        limits = [register.low, register.high or 0, (1 << register.bits) - 1]
        value = rng.choice(limits) + rng.choice([-1, 0, 0, 0, 1])
        value = rng.choice([value, rng.getrandbits(register.bits), rng.getrandbits(32),
                            -(1 << register.bits - 1), 1 << register.bits - 1])
        address = register.address if rng.random() < 0.95 else rng.getrandbits(8)
        data = bytes([address]) + (value & 0xFFFFFFFF).to_bytes(4, "little")
    elif command == Command.READ:
        data = bytes([rng.choice([*model.registers, rng.getrandbits(8)])])
    elif command == Command.BEGIN:
        data = bytearray(SENSOR)
        if rng.random() < 0.4:
            data[rng.randrange(len(SENSOR))] ^= 1 << rng.randrange(8)
    elif command == Command.TABLE:
        words = random_words(rng, table, rng.randint(1, 88 // table.octets))
        octets = b"".join(word.to_bytes(table.octets, "little") for word in words)
        data = bytes([number]) + first.to_bytes(2, "little") + octets[
            :rng.choice([len(octets)] * 6 + [len(octets) - 1, 0])]
    elif command == Command.COMMIT:
        checks = model.checks()
        if rng.random() < 0.3:
            checks[rng.randrange(len(checks))] ^= 1 << rng.randrange(32)
        data = b"".join(check.to_bytes(4, "little") for check in checks)
    elif command == Command.READ_TABLE:
        data = bytes([number]) + first.to_bytes(2, "little") + bytes([
            rng.choice([0, 1, 2, 88 // table.octets, 88 // table.octets + 1,
                        rng.getrandbits(8)])])
    elif command == Command.CAPTURE:
        data = rng.choice([0, 60_000, 65_535]).to_bytes(2, "little")
    else:
        data = b""
    if rng.random() < 0.05:
        data = bytes(data) + bytes(1) if rng.random() < 0.5 else bytes(data)[:-1]
    if rng.random() < 0.03:
        command = rng.getrandbits(8)
    return command, bytes(data)


def change_inputs(rng, host):
    """What the rest of the chip does meanwhile."""
    match rng.randrange(12):
        case 0:
            host.set(idle=rng.random() < 0.7)
        case 1:
            host.set(ready=rng.random() < 0.8)
        case 2:
            host.set(laser_armed=rng.getrandbits(1), sensor_silent=rng.getrandbits(1))
        case 3:
            host.set(guard_causes=rng.getrandbits(len(GUARD_CAUSES)),
                     pairs=rng.getrandbits(16), packets=rng.getrandbits(16),
                     display=rng.getrandbits(3), **{name: rng.getrandbits(8)
                        for name in ("timeouts", "bad_sync", "overrun", "skipped", "late")})
        case 4 | 5 if host.model.acting["mode"] != Mode.STOP:
            host.pulse(*rng.choice([["apply"], ["single_done"], ["apply", "single_done"]]))


@pytest.mark.parametrize("preset,seed", [
    ("capsule", 1), ("capsule", 2), ("capsule", 3), ("paper", 1), ("paper", 2)])
def test_random_commands(preset, seed):
    """Every reply, register, table and counter is the model's, at any stall."""
    rng = random.Random(seed)
    host = Host(preset=preset)
    reasons = set()
    for number in range(600):
        change_inputs(rng, host)
        host.stall = rng.choice([0.0, 0.0, 0.5])
        reasons.add(host.ask(*random_command(rng, host), tag=rng.getrandbits(8))[0])
        if number % 150 == 149:
            host.set(ready=1)
            host.read_everything()
    assert reasons >= set(Reason) - {Reason.DAMAGED_PACKET, Reason.NOT_STOPPED}


@pytest.mark.parametrize("seed", [1, 2])
def test_damaged_packets(seed):
    """Bits changed, octets lost and added: what passed the check is carried out, nothing else."""
    rng = random.Random(seed)
    host = Host()
    answers = []
    for _ in range(400):
        change_inputs(rng, host)
        command, data = random_command(rng, host)
        octets = bytearray(encode(bytes([command, rng.getrandbits(8)]) + data))
        if command == Command.TABLE:
            # Whether its words arrive is seen when they are read.
            host.set(ready=0)
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(octets))
            match rng.randrange(4):
                case 0 | 1:
                    octets[at] ^= 1 << rng.randrange(8)
                case 2:
                    del octets[at]
                case 3:
                    octets.insert(at, rng.choice([0, rng.getrandbits(8)]))
        clocks = host.rig.commands.commit_clocks() if command == Command.COMMIT else None
        answers += host.damaged(octets, clocks)
        host.damaged(b"\0")
    host.set(ready=1)
    host.read_everything()
    assert sum(answer[3] == Reason.DAMAGED_PACKET for answer in answers) > 200


@pytest.mark.parametrize("preset", ["capsule", "paper"])
def test_every_refusal_changes_nothing(preset):
    """Each reason, provoked in each way; then everything is read back."""
    host = Host(preset=preset)
    no_checks = bytes(4 * len(host.model.counts))
    host.set(idle=1)
    rng = random.Random(1)
    register = {entry.name: entry for entry in host.model.registers.values()}

    def word(name, value):
        return bytes([register[name].address]) + (value & 0xFFFFFFFF).to_bytes(4, "little")

    def table(number, first, octets):
        return bytes([number]) + first.to_bytes(2, "little") + bytes(octets)

    def refused(reason, command, data=b""):
        assert host.ask(command, data)[0] == reason
        seen.add(reason)

    seen = set()
    assert host.begin() == Reason.OK
    for number, count in enumerate(host.model.counts):
        assert host.load(number, random_words(rng, host.model.kinds[number], count)) == Reason.OK
    for command in (0, 11, 0x81, 0xFF):
        refused(Reason.UNKNOWN_COMMAND, command)
    for command, length in [(Command.IDENTIFY, 0), (Command.WRITE, 5), (Command.READ, 1),
                            (Command.BEGIN, 7), (Command.COMMIT, len(no_checks)),
                            (Command.READ_TABLE, 4), (Command.STATUS, 0), (Command.CAPTURE, 2),
                            (Command.CLEAR, 0)]:
        for wrong in {length - 1, length + 1, 91} - {-1}:
            refused(Reason.WRONG_LENGTH, command, bytes(wrong))
    for length in (0, 1, 2, 3, 4, 7, 9, 87, 91):
        refused(Reason.WRONG_LENGTH, Command.TABLE, bytes(length))
    refused(Reason.WRONG_LENGTH, Command.TABLE, table(RADIAL, 2000, bytes(4)))
    refused(Reason.WRONG_LENGTH, Command.TABLE, table(BEAMS, 0, bytes(88)))
    for address in {*range(256)} - set(host.model.registers):
        refused(Reason.UNKNOWN_REGISTER, Command.READ, [address])
        if not address % 8:
            refused(Reason.UNKNOWN_REGISTER, Command.WRITE, bytes([address, 1, 0, 0, 0]))
    for name, entry in register.items():
        wrong = [1 << bit for bit in range(entry.bits, 32)] + [0xFFFFFFFF]
        if entry.signed:
            wrong = [1 << entry.bits - 1, -(1 << entry.bits - 1) - 1, 1 << 31, 0x7FFFFFFF]
        wrong += [entry.low - 1] if entry.low else []
        wrong += [entry.high + 1] if entry.high is not None else []
        for value in wrong:
            refused(Reason.OUT_OF_RANGE, Command.WRITE, word(name, value))
    for number, count in enumerate(host.model.counts):
        octets = host.model.kinds[number].octets
        for first, words in [(count, 1), (count - 1, 2), (0xFFFF, 1), (1 << 10, 1), (1 << 15, 1)]:
            refused(Reason.OUT_OF_RANGE, Command.TABLE, table(number, first, bytes(octets * words)))
            refused(Reason.OUT_OF_RANGE, Command.READ_TABLE, table(number, first, [words]))
        for words in (0, 88 // octets + 1, 255):
            refused(Reason.OUT_OF_RANGE, Command.READ_TABLE, table(number, 0, [words]))
    for number in (len(host.model.counts), 5, 8, 12, 128, 255):
        refused(Reason.UNKNOWN_TABLE, Command.TABLE, table(number, 0, bytes(9)))
        refused(Reason.UNKNOWN_TABLE, Command.READ_TABLE, table(number, 0, [1]))
    for at in range(len(SENSOR)):
        for bit in range(8):
            other = bytearray(SENSOR)
            other[at] ^= 1 << bit
            refused(Reason.OTHER_SENSOR, Command.BEGIN, other)
    for number in range(len(host.model.counts)):
        checks = host.model.checks()
        checks[number] ^= 1 << 7 * number
        assert host.commit(checks) == Reason.DAMAGED_TABLE
        seen.add(Reason.DAMAGED_TABLE)
    host.set(ready=0)
    refused(Reason.BUSY, Command.TABLE, table(RADIAL, 0, bytes(3)))
    refused(Reason.BUSY, Command.READ_TABLE, table(RADIAL, 0, [1]))
    refused(Reason.BUSY, Command.COMMIT, no_checks)
    host.set(ready=1)
    host.read_everything()

    # While frames are taken: what needs a chip that stands still.
    assert host.write("mode", Mode.CONTINUOUS) == Reason.OK
    assert host.model.acting["mode"] == Mode.CONTINUOUS
    refused(Reason.NOT_STOPPED, Command.WRITE, word("divisor", 100))
    refused(Reason.NOT_STOPPED, Command.TABLE, table(RECIPROCAL, 0, bytes(5)))
    if preset == "paper":
        refused(Reason.NOT_STOPPED, Command.TABLE, table(REMAP, 0, bytes(8)))
    assert host.commit() == Reason.OK
    for command, data in [(Command.BEGIN, SENSOR), (Command.TABLE, table(RADIAL, 0, bytes(3))),
                          (Command.READ_TABLE, table(RADIAL, 0, [1])), (Command.COMMIT, no_checks)]:
        refused(Reason.BUSY, command, data)
    host.read_everything()
    host.pulse("apply")
    refused(Reason.NO_BEGIN, Command.TABLE, table(RADIAL, 0, bytes(3)))
    refused(Reason.NO_BEGIN, Command.COMMIT, no_checks)
    assert host.damaged(b"\0\3\7\0")[0][3] == Reason.DAMAGED_PACKET
    seen.add(Reason.DAMAGED_PACKET)
    host.read_everything()
    assert seen == set(Reason) - {Reason.OK}


@pytest.mark.parametrize("width,height,beams,preset,seed", [
    (352, 288, 49, "capsule", 1), (352, 288, 128, "capsule", 2), (49, 35, 3, "paper", 3)])
def test_banks_change_places(width, height, beams, preset, seed):
    """Whole sets, one after the other, in a chip that runs."""
    rng = random.Random(seed)
    host = Host(width, height, beams, 2, preset, clock_hz=16_000_000)

    def load(not_banked):
        assert host.begin() == Reason.OK
        for number, count in enumerate(host.model.counts):
            table = host.model.kinds[number]
            if table.banked or not_banked:
                assert host.load(number, random_words(rng, table, count)) == Reason.OK

    load(True)
    assert host.commit() == Reason.OK
    assert not host.model.tables_valid
    host.set(idle=1)  # stopped, and now idle: the set acts
    assert (host.block.get("bank"), host.block.get("tables_valid")) == (1, 1)
    assert host.write("mode", Mode.PATTERN) == Reason.OK
    host.set(idle=0)
    for bank in (0, 1):
        load(False)
        host.read_everything()
        assert host.commit([0] * len(host.model.counts)) == Reason.DAMAGED_TABLE
        assert host.block.get("tables_valid") and host.block.get("bank") == 1 - bank
        # The set is still open: one more word, and it is right.
        assert host.load(RADIAL, [5], 1023) == Reason.OK
        assert host.write("threshold_alpha", 10 + bank) == Reason.OK
        assert host.commit() == Reason.OK
        assert host.block.get("bank") == 1 - bank
        assert host.block.get("threshold_alpha") != 10 + bank
        host.pulse("apply")
        assert host.block.get("bank") == bank and host.block.get("threshold_alpha") == 10 + bank
    # What has one bank spoils the set that acts until a set is checked.
    assert host.write("mode", Mode.STOP) == Reason.OK
    host.pulse("apply")
    for table, count in zip(host.model.kinds, host.model.counts, strict=True):
        assert host.begin() == Reason.OK and host.block.get("tables_valid")
        assert host.load(table.number, [1], count - 1) == Reason.OK
        assert host.block.get("tables_valid") == table.banked
        assert host.commit() == Reason.OK
        host.set(idle=1)
        assert host.block.get("tables_valid")
        host.set(idle=0)


@pytest.mark.parametrize("preset", ["capsule", "paper"])
def test_tables_that_are_needed_meanwhile(preset):
    """Spots take the tables again and again: accesses wait, and nothing else changes."""
    rng = random.Random(3)
    host = Host(preset=preset)
    host.block.set(flicker=1)

    def insist(command, data):
        content = bytes([command, 1]) + bytes(data)
        for _ in range(40):
            clocks = 4 * host.rig.commands.commit_clocks() if command == Command.COMMIT else 4000
            got, = host.send(encode(content), clocks + rng.randrange(4))
            if got[3] != Reason.BUSY:
                assert got == host.model.reply(content)
                return
            host.model.ready = False
            assert got == host.model.reply(content)
            host.model.ready = True
        raise AssertionError("always busy")

    host.begin()
    for number, count in enumerate(host.model.counts):
        table = host.model.kinds[number]
        for first in range(0, count, 50):
            words = random_words(rng, table, min(count - first, 88 // table.octets))
            head = bytes([number]) + first.to_bytes(2, "little")
            insist(Command.TABLE, head + b"".join(
                word.to_bytes(table.octets, "little") for word in words))
            insist(Command.READ_TABLE, head + bytes([len(words)]))
            host.writes += len(words)
    insist(Command.COMMIT, b"".join(check.to_bytes(4, "little") for check in host.model.checks()))
    host.pulse("apply")
    host.compare()


def test_counters_stop_at_their_ends():
    host = Host()
    host.send(b"", 1)
    for _ in range(3):
        host.block.set(framing=1, damage=1)
        host.send(b"", 30_000)
        host.block.set(framing=0, damage=0)
        host.send(b"", 100)
    host.model.status.update(framing=255, damaged=65_535)
    host.read_everything()


def test_is_small():
    verilog = to_verilog(Commands(352, 288, 49, 2), "commands")
    assert measure_verilog(verilog, "commands", muxf=False)["lut4"] <= 1150


@pytest.mark.parametrize("arguments,error", [
    ((15, 64, 4, 2), "Frame width must be an integer from 16 to 1024, not 15"),
    ((64, 1025, 4, 2), "Frame height must be an integer from 16 to 1024, not 1025"),
    ((64, 64, 513, 2), "Beams must be an integer from 1 to 512, not 513"),
    ((64, 64, 4, 5), "Lanes must be an integer from 1 to 4, not 5"),
    ((64, 64, 4, 2, "foo"), "Preset must be one of capsule, paper, not 'foo'"),
    ((64, 64, 4, 2, "paper", 66_000_000),
     "System clock must be an integer from 1000000 to 65000000, not 66000000"),
    ((64, 64, 4, 2, "paper", 1_500_000), "System clock must be a multiple of 1 MHz, not 1500000"),
    ((64, 64, 4, 2, "paper", 1_000_000, 700_000),
     "700000 baud cannot be made of a clock of 1000000 Hz: a bit must take 2 to 65535 clocks"),
    ((64, 64, 4, 2, "paper", 1_000_000, "fast"),
     "Baud rate must be a positive integer, not 'fast'"),
])
def test_wrong_parameters(arguments, error):
    with pytest.raises(ValueError) as caught:
        Commands(*arguments)
    assert str(caught.value) == error
