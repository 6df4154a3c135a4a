# amaranth: UnusedElaboratable=no
"""The tables and the example of the READMEs say what the chip does."""

import re
from enum import IntEnum

import numpy as np
import pytest

from hdl import protocol
from hdl.link.commands import Commands
from model.link.framer import frame, wire_octets
from model.link.points import POINT, PatternFrame, packets
from scripts.paths import ROOT
from scripts.rtl import readme_tables as tables
from scripts.rtl.blocks import BLOCKS
from tb.link.command_host import Host

README = (ROOT / "hdl" / "link" / "README.md").read_text()


def test_tables_are_fresh(capsys):
    assert tables.main(["--check"]) == 0
    assert capsys.readouterr().out == ""


def test_stale_tables_are_named_and_written(monkeypatch, capsys, tmp_path):
    for name in tables.FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text((ROOT / name).read_text())
    stale = tmp_path / tables.FILES[0]
    stale.write_text(stale.read_text().replace(
        "| `threshold_alpha` | 8 |", "| `threshold_alpha` | 9 |"))
    monkeypatch.setattr(tables, "ROOT", tmp_path)
    assert tables.main(["--check"]) == 1
    assert capsys.readouterr().out == (
        "Tables are stale in hdl/link/README.md: run `python -m scripts.rtl.readme_tables`.\n")
    assert tables.main([]) == 0
    assert tables.main(["--check"]) == 0
    assert stale.read_text() == README


def test_stale_columns_are_written():
    text = (ROOT / "hdl" / "README.md").read_text()
    row = "| `preprocessing/spot_queue` | Spot | QueuedSpot, Counts | {} | {} |"
    right = row.format(2, "2 x 128 x 36")
    assert right in text
    for wrong in (row.format(3, "2 x 128 x 36"), row.format(2, "128 x 36")):
        assert tables.updated(text.replace(right, wrong)) == text
    # They are those of the preset.
    assert tables.columns("stereo/epipolar", "capsule") == {
        "Latency": "28", "Memory": "2 x 128 x 36"}
    assert tables.columns("stereo/epipolar", "paper") == {"Latency": "4", "Memory": "50 x 128 x 36"}
    assert tables.columns("acquisition/camera", "capsule")["Latency"] == "3 at most"


@pytest.mark.parametrize("block", BLOCKS, ids=[block.name for block in BLOCKS])
def test_every_block_says_its_latency(block):
    latency = tables.columns(block.name, block.preset)["Latency"]
    assert re.fullmatch(r"[\d,]+( at most)?", latency)


def test_unknown_columns():
    with pytest.raises(LookupError, match="There is no block 'foo'"):
        tables.columns("foo", "capsule")
    with pytest.raises(LookupError, match="docstring of reconstruction has no"):
        tables.columns("reconstruction", "capsule")


def test_every_table_is_shown():
    assert {name for _, name, _ in tables._MARKED.findall(README)} == set(tables.TABLES)


@pytest.mark.parametrize("enumeration", [
    value for value in vars(protocol).values()
    if isinstance(value, type) and issubclass(value, IntEnum) and value is not IntEnum],
    ids=lambda enumeration: enumeration.__name__)
def test_every_member_has_a_meaning(enumeration):
    found = tables.meanings(enumeration)
    assert list(found) == list(enumeration.__members__)
    assert all(found.values())


def test_the_example_is_what_the_chip_answers():
    """The session of the README, sent to RTL and model out of reset."""
    session = re.search(r"### An example.*?```\n(.*?)```", README, re.S)[1]
    host = Host(352, 288, 49, 2, clock_hz=16_000_000)
    host.set(idle=1)
    lines = [line for line in session.splitlines() if not line.startswith("#")]
    sequence, reasons = 0, set()
    for asked, answered in zip(lines[::2], lines[1::2], strict=True):
        assert asked.startswith("host  ") and answered.startswith("chip  ")
        octets = bytes.fromhex(asked[6:])
        clocks = 2000 + host.rig.commands.commit_clocks()
        got, = host.send(octets, clocks)
        assert [got] == host.model.receive(octets)
        (packet,), sequence = frame([got], sequence)
        assert packet.hex(" ") == answered[6:]
        reasons.add(got[3])
        host._settle()
    assert host.block.get("tables_valid") and host.block.get("mode") == protocol.Mode.CONTINUOUS
    assert len(lines) == 18 and reasons == {0, 4, 11}


def test_time_of_a_commit():
    assert "which takes 4 ms in the preset `capsule`" in README
    assert round(Commands(352, 288, 49, 2).commit_clocks() / 16_000) == 4
    assert "and 156 ms with a remap table in `paper`, at 352 x 288 pixels" in README
    assert round(Commands(352, 288, 49, 49, "paper").commit_clocks() / 16_000) == 156


def test_octets_of_a_frame():
    rows = re.search(r"\| Points \| Octets \|\n\|---\|---\|\n(.*?)\n\n", README, re.S)[1]
    for count, octets in re.findall(r"\| (\d+) \| (\d+) \|", rows):
        points = np.zeros(int(count), POINT)
        points["u"], points["v"], points["area"] = 1000, 400 * np.arange(int(count)), 30
        sent = packets(PatternFrame(points=points, spots=len(points)))
        assert wire_octets(sent) == int(octets)


def test_what_the_check_is_worth():
    """Damaged packets, and those that checks of 16 and 32 bits would pass, at 1e-4."""
    damaged = 1 - (1 - 1e-4) ** (8 * protocol.WIRE_LIMIT)
    per_second = damaged * 11_520 / (protocol.WIRE_LIMIT + protocol.GAP_CHARACTERS)
    assert "one packet of full length in 13" in README and round(1 / damaged) == 13
    assert "about 9 a second" in README and round(per_second) == 9
    assert "every two hours" in README and round(2**16 / per_second / 3600) == 2
    assert "every 16 years" in README and round(2**32 / per_second / 3600 / 24 / 365) == 16
