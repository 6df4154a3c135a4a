# amaranth: UnusedElaboratable=no
"""No reader sees a torn frame, whatever the clocks; and what a bank costs."""

from pathlib import Path

import pytest

from hdl.acquisition.frame_memory import FrameMemory
from hdl.export import to_verilog
from scripts.rtl.size import measure_verilog
from tb.acquisition.bank_faults import planted
from tb.acquisition.tb_frame_memory import CLOCKS
from tb.hdlsim import run

WIDTH, HEIGHT = 7, 5
RIG = Path(__file__).with_name("frame_memory_rig.v").read_text()


def play(request, clocks, seed, banks=3, least=1, memory=None, **settings):
    """One case of the rig; ``least`` frames have to reach the reader."""
    settings = {"frames": 300, "hold": 100, "seed": seed, **settings}
    memory = memory or FrameMemory(WIDTH, HEIGHT, banks)
    run(request, "frame_memory_rig", "tb.acquisition.tb_frame_memory",
        verilog={"frame_memory.v": to_verilog(memory, "frame_memory"), "frame_memory_rig.v": RIG},
        parameters={"clocks": clocks, "settings": settings, "least": least, "banks": banks},
        build_args=["--timing", "--no-sched-zero-delay"])


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("banks", [2, 3])
@pytest.mark.parametrize("clocks", CLOCKS)
def test_frames_are_whole(request, clocks, banks, seed):
    """Frames back to back or not, faulty or not; readers that hold them for long or not."""
    settings = {"gap": 60, "faulty": 40, "blanking": 20, "idling": 30} if seed == 1 else {
        "reads_along": 1}
    play(request, CLOCKS[clocks], seed, banks, least=25, **settings)


@pytest.mark.parametrize("seed", [3])
@pytest.mark.parametrize("banks", [2, 3])
@pytest.mark.parametrize("hold", [0, 12])
@pytest.mark.parametrize("clocks", ["25.000 MHz to 25.001 MHz", "25.001 MHz to 25.000 MHz"])
def test_every_phase(request, clocks, hold, banks, seed):
    """The clocks drift by 2 ps a clock, through two whole periods; the reader asks all the time."""
    play(request, CLOCKS[clocks], seed, banks, least=2000, frames=1200, hold=hold)


@pytest.mark.parametrize("seed", [4])
@pytest.mark.parametrize("banks", [2, 3])
@pytest.mark.parametrize("clocks", ["8 MHz to 25.175 MHz", "the same"])
def test_long_holds_and_bursts(request, clocks, banks, seed):
    """A frame is held while many others come, in bursts with long pauses between."""
    play(request, CLOCKS[clocks], seed, banks, least=20, hold=1900, blanking=900)


@pytest.mark.parametrize("seed", [5])
@pytest.mark.parametrize("fault", [
    "the writer takes the reader's bank", "the reader does not wait for the answer",
    "the newest frame is given away"])
def test_planted_faults_are_found(request, fault, seed, monkeypatch):
    monkeypatch.setattr("hdl.acquisition.frame_memory.FrameBanks",
                        lambda *arguments: planted(fault, *arguments))
    with pytest.raises(pytest.fail.Exception, match="of another frame|not the newest"):
        play(request, CLOCKS["16 MHz to 25.175 MHz"], seed)


@pytest.mark.parametrize("size, banks, blocks", [((352, 288), 2, 100), ((64, 64), 3, 6)])
def test_memory_is_block_memory(size, banks, blocks):
    """A bank of 352 x 288 is 50 RAMB16, and no pixel is in tables."""
    memory = FrameMemory(*size, banks)
    cost = measure_verilog(to_verilog(memory, "frame_memory"), "frame_memory")
    assert cost["ramb16"] == blocks
    assert not cost["distributed"] and not cost["latches"]
    assert cost["lut4"] < 250 and cost["ff"] < 250, cost


@pytest.mark.parametrize("arguments, error", [
    ((1, 5), "Frame width must be an integer from 2 to 512, not 1"),
    ((8, "x"), "Frame height must be an integer from 2 to 512, not 'x'"),
    ((8, 8, 4), "The number of banks must be 2 or 3, not 4"),
    ((8, 8, True), "The number of banks must be 2 or 3, not True"),
])
def test_refuses_parameters(arguments, error):
    with pytest.raises(ValueError) as caught:
        FrameMemory(*arguments)
    assert str(caught.value) == error
