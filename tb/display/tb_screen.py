"""A camera in one clock and a screen in another; the work is done in the rig."""

import cocotb
from cocotb.triggers import RisingEdge, Timer

from tb.harness import parameters


@cocotb.test()
async def record(dut):
    """Record so many screens."""
    for name, value in parameters()["rig"].items():
        getattr(dut, name).value = value
    await Timer(1, "ns")
    dut.running.value = 1
    await Timer(1, "us")
    dut.rst.value = 0
    await RisingEdge(dut.done)
    if parameters()["sram"]:
        for name in ("broken", "late", "violations", "unwritten"):
            assert not int(getattr(dut, name).value), name
        cocotb.log.info(f"{int(dut.reads.value)} reads, {int(dut.writes.value)} writes")
