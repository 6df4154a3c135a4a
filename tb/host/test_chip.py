"""Commands to the chip: what is lost, late, damaged or refused."""

import time

import pytest

from hdl.protocol import Command, Mode, Reason
from model.errors import UserError
from scripts.host.chip import REGISTERS, SENTENCES, RefusedError
from scripts.host.loading import load
from tb.host.bench import INSTRUMENTS, commands, open_fake
from tb.system.fake_instrument import images


@pytest.mark.parametrize("kind, fault, at", [
    *(("fake", fault, at) for fault in ("deaf", "damaging", "mute", "busy")
      for at in (0, 1, 40, 80, *range(111, 115))),
    *(("rtl", fault, at) for fault in ("deaf", "damaging", "mute") for at in (40, 113))])
def test_a_lost_command_or_answer_is_sent_again(kind, fault, at, rig):
    """Whichever it is, the tables are loaded in the end."""
    calibration, _ = rig
    with INSTRUMENTS[kind](calibration, images()) as terminal:
        instrument, count = terminal.instrument, 0
        take = instrument._take

        def counted(content):
            nonlocal count
            if count == at:
                setattr(instrument, fault, 2)
            count += 1
            take(content)

        instrument._take = counted
        with commands(terminal, timeout=0.08 if kind == "fake" else 0.5, patience=5.0) as asking:
            load(asking, calibration)
            asking.write("mode", Mode.CONTINUOUS)
            end = time.monotonic() + 5
            while not (valid := asking.status()["state"].tables_valid) and time.monotonic() < end:
                pass
        assert valid and getattr(instrument, fault) == 0 and count > at + 2


def test_reasons_for_no_answer_are_told_apart(rig):
    """No chip, one that nothing reaches, a damaging line, a busy chip, garbage."""
    with open_fake(rig[0], images()) as terminal, commands(terminal, tries=2) as asking:
        fake = terminal.instrument
        fake.deaf = 99
        with pytest.raises(UserError, match="does not answer the command STATUS: is it powered"):
            asking.status()
        fake.deaf = 0
        asking.write("mode", Mode.CONTINUOUS)
        fake.deaf = 99
        with pytest.raises(UserError, match="it sends packets, but none arrives there"):
            asking.status()
        fake.deaf, fake.damaging = 0, 99
        with pytest.raises(RefusedError, match="commands arrive damaged"):
            asking.status()
        fake.damaging, fake.busy = 0, 9999
        with pytest.raises(RefusedError, match="still waits for its frame") as refused:
            asking.status()
        assert refused.value.reason == Reason.BUSY
        fake.busy = 0
        assert asking.status()["state"].mode == Mode.CONTINUOUS
        asking.port.write(b"\x55" * 30)  # garbage on the line hurts no command
        assert asking.read("threshold_alpha") == REGISTERS["threshold_alpha"].reset


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_has_a_sentence(reason):
    if reason:
        text = str(RefusedError("this", reason))
        assert text.startswith("The chip refused this: ") and text[-1] in ".?"
        assert text == f"The chip refused this: {SENTENCES[reason]}"
    assert "reason 99, which this program does not know." in str(RefusedError("this", 99))


def test_reasons_come_through(each_terminal):
    """Each refusal that a host can provoke, from the chip to the sentence."""
    with commands(each_terminal, timeout=0.5) as asking:
        words = {name: [0] * 9 for name in ("depth", "reciprocal", "radial", "beams")}
        table = next(each for each, _, _ in asking.chunks(words) if each.name == "reciprocal")
        for reason, provoke in {
                Reason.UNKNOWN_COMMAND: lambda: asking.ask(99, what="this"),
                Reason.WRONG_LENGTH: lambda: asking.ask(Command.READ),
                Reason.UNKNOWN_REGISTER: lambda: asking.ask(Command.READ, b"\xff"),
                Reason.OUT_OF_RANGE: lambda: asking.write("area_min", 0),
                Reason.NO_BEGIN: lambda: asking.commit(words),
                Reason.OTHER_SENSOR: lambda: asking.begin(64, 64, 15),
                Reason.DAMAGED_TABLE: lambda: (asking.begin(64, 64, 16), asking.commit(words)),
                Reason.UNKNOWN_TABLE: lambda: asking.ask(Command.READ_TABLE, b"\x09\0\0\1"),
                Reason.NOT_STOPPED: lambda: (asking.write("mode", 1),
                                             asking.write_table(table, 0, [1]))}.items():
            try:
                provoke()
            except RefusedError as refused:
                assert refused.reason == reason and SENTENCES[reason] in str(refused)
            else:
                pytest.fail(f"{reason.name} did not come through")
