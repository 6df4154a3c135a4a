"""Tables and registers into the chip, read back and checked."""

import time

from hdl.protocol import (
    COMPACT,
    CONTENT_LIMIT,
    GAP_CHARACTERS,
    REMAP,
    TRAILER_FIELDS,
    WIRE_LIMIT,
    Mode,
)
from model.errors import UserError
from scripts.host.chip import REGISTERS
from scripts.host.framing import CHECK_OCTETS
from scripts.host.messages import RECORD_OCTETS

__all__ = ["load", "points_carried", "registers_of", "signed", "stop", "wait_until",
           "write_registers"]

_HEADER = 3  # kind, sequence number, number of the frame
#: Octet times of a full packet of points, the pause after it included, and octets of its points.
_FULL_PACKET = WIRE_LIMIT + GAP_CHARACTERS
_POINTS_OCTETS = CONTENT_LIMIT - CHECK_OCTETS - _HEADER
#: Octet times of a frame without points: a packet with the trailer alone.
_EMPTY_FRAME = _FULL_PACKET - _POINTS_OCTETS + sum(field.bits for field in TRAILER_FIELDS) // 8


def signed(name, value):
    """The value that the bits ``value`` of a register stand for."""
    register = REGISTERS[name]
    return value - (1 << register.bits) if (
        register.signed and value >> register.bits - 1) else value


def registers_of(calibration):
    """Values of the registers that a calibration needs, by name.

    ``points_max`` has room for the whole mesh, a quarter of it twice.
    """
    settings, beams = calibration.settings, len(calibration.settings.line)
    return {**{name: signed(name, value) for name, value in settings.registers().items()},
            "points_max": min(max(REGISTERS["points_max"].reset, beams + beams // 4),
                              (1 << REGISTERS["points_max"].bits) - 1)}


def points_carried(baud, period_us, full_records=False):
    """About how many of a frame's points the line carries in a period, at least 0."""
    in_packet = 8 * _POINTS_OCTETS // (8 * RECORD_OCTETS if full_records else COMPACT.SHORT_BITS)
    octets = baud / 10 * period_us * 1e-6
    return max(0, int((octets - _EMPTY_FRAME) * in_packet / _FULL_PACKET))


def write_registers(commands, chosen):
    """Write registers and read them back."""
    for name, value in chosen.items():
        commands.write(name, value)
    for name, value in chosen.items():
        got = commands.read(name)
        if got != value:
            raise UserError(f"The chip took {name} = {value} and reads back {got}: "
                            "the chip is at fault, or another program writes too.")


def wait_until(commands, done, seconds):
    """The first status for which ``done(state)`` holds, or the last one after so many seconds."""
    end = time.monotonic() + seconds
    while True:
        status = commands.status()
        if done(status["state"]) or time.monotonic() > end:
            return status
        time.sleep(0.02)


def stop(commands, seconds=10.0):
    """Stop the chip and wait until it did."""
    commands.write("mode", Mode.STOP)
    state = wait_until(commands, lambda state: state.mode == Mode.STOP, seconds)["state"]
    if state.mode != Mode.STOP:
        raise UserError("The chip does not stop" + (
            ", for its sensor is silent: reset the chip." if state.silent else ": reset it."))


def load(commands, calibration, progress=None):
    """Load all tables into a chip that is stopped, read them back, and commit them.

    The remap table of the preset ``paper`` is not read over the line, which would take as long
    as to send it: the chip reads it back, as all tables, to check it.

    Parameters
    ----------
    commands : :class:`scripts.host.commands.Commands`
        The chip.
    calibration : :class:`calibration.file.Calibration`
        What to load.
    progress : callable or None
        Called with the words done and the words in all.
    """
    words = calibration.settings.tables()
    total, done = 2 * sum(map(len, words.values())) - len(words.get(REMAP.name, ())), 0

    def step(count):
        nonlocal done
        done += count
        if progress:
            progress(done, total)

    commands.begin(calibration.width, calibration.height, len(calibration.settings.line))
    for table, first, some in commands.chunks(words):
        commands.write_table(table, first, some)
        step(len(some))
    for table, first, some in commands.chunks(words):
        if table == REMAP:
            continue
        got = commands.read_table(table, first, len(some))
        if got != some:
            wrong = next(at for at, (a, b) in enumerate(zip(got, some, strict=True)) if a != b)
            raise UserError(f"The table {table.name} reads back other than it was written, from "
                            f"word {first + wrong} on: load again; if it stays so, the chip is at "
                            "fault.")
        step(len(some))
    commands.commit(words)
