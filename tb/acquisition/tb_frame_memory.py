"""A camera and a reader with unrelated clocks on a frame memory; the work is done in the rig."""

import cocotb
from cocotb.triggers import RisingEdge, Timer

from tb.harness import parameters

#: (writer's, reader's) clock period in picoseconds.
CLOCKS = {
    "8 MHz to 25.175 MHz": (125_000, 39_722),
    "16 MHz to 25.175 MHz": (62_500, 39_722),
    "25.000 MHz to 25.001 MHz": (40_000, 39_998),
    "25.001 MHz to 25.000 MHz": (39_998, 40_000),
    "the same": (40_000, 40_000),
    "40 times slower reader": (10_000, 401_000),
    "40 times faster reader": (401_000, 10_000),
}


async def play(dut, sync_ps, display_ps, offset_ps=0, **settings):
    """Run a case from reset to its end; all counters of the rig, by name."""
    for name, value in {"sync_ps": sync_ps, "display_ps": display_ps, "offset_ps": offset_ps,
                        **settings}.items():
        getattr(dut, name).value = value
    await Timer(1, "ns")
    dut.running.value = 1
    await Timer(10 * max(sync_ps, display_ps), "ps")
    dut.rst.value = 0
    dut.display_rst.value = 0
    await RisingEdge(dut.done)
    names = ("whole", "faults", "granted", "fresh_ones", "compared", "torn", "stale", "changed",
             "longest", "broken", "skipped", "unread", "newest", "mine")
    return {name: getattr(dut, name).value.to_unsigned() for name in names}


@cocotb.test(timeout_time=1000, timeout_unit="ms")
async def case(dut):
    """One case of the pytest half."""
    given = parameters()
    got = await play(dut, *given["clocks"], **given["settings"])
    cocotb.log.info(f"{got}")
    assert not got["torn"], f"{got['torn']} of {got['compared']} pixels are of another frame"
    assert not got["stale"], f"{got['stale']} frames are not the newest, or reported wrongly"
    assert not got["changed"], f"{got['changed']} times a frame went while it was held"
    assert got["granted"] >= given["least"], f"only {got['granted']} frames were read"
    assert got["broken"] == min(255, got["faults"]) or given["banks"] == 2
    if max(got["skipped"], got["unread"]) < 255:
        assert got["mine"] == got["newest"], "the reader did not get the last frame"
    if given["banks"] == 3:
        assert not got["skipped"], "a frame was refused"
    if max(got["broken"], got["skipped"], got["unread"]) < 255:
        assert got["whole"] + got["faults"] == (
            got["broken"] + got["skipped"] + got["unread"] + got["fresh_ones"])
    sync_ps, display_ps = given["clocks"]
    assert got["longest"] <= 5 + -(-4 * sync_ps // display_ps)
